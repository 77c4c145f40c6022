"""Writes a corrected recording to an .npz, .csv, .h5 or .parquet file, atomically.

npz: `t_s` (n,), `rate_rad_s`, `rate_std_rad_s`, `bias_rad_s`, `bias_std_rad_s` (n, 3), `quality` (n,) as a number,
`quality_names`, `quat_wxyz` (n, 4) sensor to earth, scalar first, `tilt_std`, `heading_std` (n,) in rad, `matrix` (3, 3) and
`rate_hz`. If recorded, also `accel_m_s2` (n, 3) and `temperature_c` (n,).

CSV: a header row, then a row per sample, with the same quantities in the same units. A vector has a column per axis:
rate_x_rad_s, rate_std_x_rad_s, bias_x_rad_s, bias_std_x_rad_s …; quality is given by name; then quat_w … quat_z, tilt_std,
heading_std.

HDF5 (.h5) has the arrays of npz as datasets, Parquet the columns of CSV.
"""

import os
import zipfile
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.recording.error import RecordingError
from bridge.recording.export import flat
from bridge.recording.formats.registry import check_extra
from bridge.wire.messages import Quality
from estimator.geometry.gyro_model import AXES
from estimator.offline.corrected_recording import CorrectedRecording, Floats, Singles

_QUALITIES = tuple(quality.name for quality in sorted(Quality))
_VECTORS = ("rate", "rate_std", "bias", "bias_std")
_ROWS = 10_000
_NO_COLUMNS = ("quality_names", "matrix", "rate_hz")


def check(out: Path, recorded: Path) -> None:
    """Refuse an output path that cannot be written to, before anything is computed. Raises RecordingError.

    An existing file may be overwritten only if truerate wrote it as a corrected recording.
    """
    if out.suffix not in _WRITERS:
        raise RecordingError(f"{out}: a corrected recording ends in {', '.join(_WRITERS)}, not in {out.suffix!r}")
    check_extra(out)
    if not out.parent.is_dir():
        raise RecordingError(f"{out}: there is no folder {out.parent}; make it with mkdir -p, or give another folder")
    if not os.access(out.parent, os.W_OK | os.X_OK):
        raise RecordingError(f"{out}: no permission to write in {out.parent}; give another folder")
    if out.is_dir():
        raise RecordingError(f"{out}: is a folder; give a file name")
    if out.exists() and not out.is_file():
        raise RecordingError(f"{out}: is not a file, but a pipe or a device; give a file's name")
    if out.exists() and recorded.exists() and out.samefile(recorded):
        raise RecordingError(f"{out}: is the recording itself and is never overwritten; give another name")
    if out.exists() and not _is_corrected(out):
        raise RecordingError(
            f"{out}: the file exists and is not a corrected recording; give another name, or remove the file"
        )


def _is_corrected(path: Path) -> bool:
    """Whether a file is a corrected recording, which may be overwritten."""
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                return "quality_names.npy" in archive.namelist()
        if path.suffix == ".h5":
            from bridge.recording.formats import hdf5  # noqa: PLC0415 - an extra

            return hdf5.holds(path, "quality_names")
        if path.suffix == ".parquet":
            from bridge.recording.formats import parquet  # noqa: PLC0415 - an extra

            return parquet.holds(path, "rate_std_x_rad_s")
        with path.open("rb") as file:
            return file.readline(80).startswith(b"t_s,rate_x_rad_s,")
    except (OSError, zipfile.BadZipFile):
        return False


def save(
    out: Path, corrected: CorrectedRecording, recording: Recording, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a corrected recording to `out`, in the format of its suffix: a temporary file beside it is renamed.

    progress(done, n) counts rows. Call `check` first: it refuses unusable paths.
    """
    part = out.with_name(f".{out.name}.part")
    try:
        part.unlink(missing_ok=True)  # left by a killed process; unlinked, so that nothing is written through a link
        with part.open("x+b") as file:  # HDF5 is also read while it is written
            _WRITERS[out.suffix](file, corrected, recording, progress or (lambda _done, _n: None))
            file.flush()
            os.fsync(file.fileno())  # without it a power loss may leave the new name on an empty file
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)


def _arrays(c: CorrectedRecording, recording: Recording) -> dict[str, NDArray[np.generic]]:
    return {
        "t_s": c.time_s,
        **{f"{name}_rad_s": getattr(c, name) for name in _VECTORS},
        "quality": c.quality,
        "quality_names": np.array(_QUALITIES),
        **_orientation(c),
        "matrix": c.matrix,
        "rate_hz": np.array(c.rate_hz),
        **_passed_on(recording),
    }


def _save_npz(
    file: IO[bytes], c: CorrectedRecording, recording: Recording, progress: Callable[[int, int], None]
) -> None:
    np.savez(file, allow_pickle=False, **_arrays(c, recording))
    progress(len(c), len(c))


def _save_hdf5(
    file: IO[bytes], c: CorrectedRecording, recording: Recording, progress: Callable[[int, int], None]
) -> None:
    from bridge.recording.formats import hdf5  # noqa: PLC0415 - an extra

    hdf5.write(file, _arrays(c, recording))
    progress(len(c), len(c))


def _save_parquet(
    file: IO[bytes], c: CorrectedRecording, recording: Recording, progress: Callable[[int, int], None]
) -> None:
    from bridge.recording.formats import parquet  # noqa: PLC0415 - an extra

    arrays = {**_arrays(c, recording), "quality": np.array(_QUALITIES)[c.quality]}
    parquet.write(file, flat({name: arrays[name] for name in arrays if name not in _NO_COLUMNS}))
    progress(len(c), len(c))


def _save_csv(
    file: IO[bytes], c: CorrectedRecording, recording: Recording, progress: Callable[[int, int], None]
) -> None:
    passed_on = {**_orientation(c), **_passed_on(recording)}
    names = ["t_s", *(f"{vector}_{axis}_rad_s" for vector in _VECTORS for axis in AXES), "quality"]
    names += [*(f"quat_{axis}" for axis in "wxyz"), "tilt_std", "heading_std"]
    names += [f"accel_{axis}_m_s2" for axis in AXES] if "accel_m_s2" in passed_on else []
    names += ["temperature_c"] if "temperature_c" in passed_on else []
    form = ",".join(["%.6f", *["%.9g"] * 12, "%s", *["%.9g"] * (len(names) - 14)]) + "\n"
    file.write((",".join(names) + "\n").encode())
    for start in range(0, len(c), _ROWS):
        part = slice(start, start + _ROWS)
        numbers = [c.time_s[part, None], *(getattr(c, name)[part].astype(float) for name in _VECTORS)]
        quality = np.array(_QUALITIES)[c.quality[part]].tolist()
        more = [column[part].reshape(len(quality), -1) for column in passed_on.values()]
        before, after = np.hstack(numbers).tolist(), np.hstack([np.empty((len(quality), 0)), *more]).tolist()
        rows = zip(before, quality, after, strict=True)
        file.write("".join(form % tuple(chain(b, (q,), a)) for b, q, a in rows).encode())
        progress(min(part.stop, len(c)), len(c))


def _orientation(c: CorrectedRecording) -> dict[str, Singles | Floats]:
    return {"quat_wxyz": c.quat_wxyz, "tilt_std": c.tilt_std, "heading_std": c.heading_std}


def _passed_on(recording: Recording) -> dict[str, Floats]:
    columns = {"accel_m_s2": recording.accel, "temperature_c": recording.temperature_c}
    return {name: column for name, column in columns.items() if column is not None}


_WRITERS = {".npz": _save_npz, ".csv": _save_csv, ".h5": _save_hdf5, ".parquet": _save_parquet}
