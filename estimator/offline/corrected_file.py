"""Files of a corrected recording: writes .npz, .csv, .h5 or .parquet, atomically.

npz contains these arrays for n samples:
- `t_s` (n,): seconds since the first sample.
- `rate_rad_s`, `rate_std_rad_s` (n, 3): corrected rate and its standard deviation.
- `bias_rad_s`, `bias_std_rad_s` (n, 3): bias and its standard deviation.
- `quality` (n,): number of the quality; `quality_names`: names by number.
- `quat_wxyz` (n, 4): attitude, sensor to earth, scalar first; `tilt_std`, `heading_std` (n,): rad.
- `matrix` (3, 3): calibration matrix; `rate_hz`: output data rate.
- If recorded: `accel_m_s2` (n, 3) and `temperature_c` (n,).

CSV has a header row, then a row per sample, with the same quantities in the same units. A vector has a column per axis:
rate_x_rad_s, rate_std_x_rad_s, bias_x_rad_s, bias_std_x_rad_s …. Quality is given by name. Then follow quat_w … quat_z,
tilt_std, heading_std.

HDF5 (.h5) has the arrays of npz as datasets, Parquet the columns of CSV.
"""

import os
import zipfile
from pathlib import Path

import numpy as np

from bridge.recording import Recording, column_files
from bridge.recording.column_files import ARRAYS, ENDINGS, Columns, Tell
from bridge.recording.error import RecordingError
from bridge.recording.files import new_file
from bridge.recording.formats.registry import check_extra
from bridge.wire.messages import Quality
from estimator.offline.corrected_recording import CorrectedRecording

#: array by which a corrected recording is told from other files
_MARK = "quality_names"


def check(out: Path, recorded: Path) -> None:
    """Refuse an output path that cannot be written to, before the correction starts.

    out: the output path. recorded: path of the recording. An existing file may be overwritten only if truerate wrote it
    as a corrected recording. Raises RecordingError if the path is refused.
    """
    if out.suffix not in ENDINGS:
        raise RecordingError(f"{out}: a corrected recording ends in {', '.join(ENDINGS)}, not in {out.suffix!r}")
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
    """Return whether a file is a corrected recording, which may be overwritten."""
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                return f"{_MARK}.npy" in archive.namelist()
        if path.suffix == ".h5":
            from bridge.recording.formats import hdf5  # noqa: PLC0415 - an extra

            return hdf5.holds(path, _MARK)
        if path.suffix == ".parquet":
            from bridge.recording.formats import parquet  # noqa: PLC0415 - an extra

            return parquet.holds(path, "rate_std_x_rad_s")
        with path.open("rb") as file:
            return file.readline(80).startswith(b"t_s,rate_x_rad_s,")
    except (OSError, zipfile.BadZipFile):
        return False


def save(out: Path, corrected: CorrectedRecording, recording: Recording, tell: Tell | None = None) -> None:
    """Write a corrected recording to `out` atomically, in the format of its ending; an old file is replaced.

    tell(done, n): called with the number of rows written, and of all rows; only for .csv. Call `check` first, which
    refuses unusable paths.
    Raises RecordingError if writing fails.
    """
    c, qualities = corrected, np.array([quality.name for quality in sorted(Quality)])
    passed_on = {"accel_m_s2": recording.accel, "temperature_c": recording.temperature_c}
    columns: Columns = {
        "t_s": c.time_s,
        **{f"{name}_rad_s": getattr(c, name) for name in ("rate", "rate_std", "bias", "bias_std")},
        "quality": c.quality if out.suffix in ARRAYS else qualities[c.quality],
        "quat_wxyz": c.quat_wxyz,
        "tilt_std": c.tilt_std,
        "heading_std": c.heading_std,
        **{name: column for name, column in passed_on.items() if column is not None},
    }
    facts = {_MARK: qualities, "matrix": c.matrix, "rate_hz": np.array(c.rate_hz)}
    with new_file(out, replace=True) as file:
        column_files.write(file, out.suffix, columns, facts, tell)
