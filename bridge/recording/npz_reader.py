"""Reads NumPy's .npz as the columns of a recording.

`gyro_rad_s` (n, 3) is required. `accel_m_s2` (n, 3), `temperature_c` (n,), `t_s` (n,), `rate_hz`, and `device` and
`boot` as an export writes them, are optional. Other arrays are ignored, also `arrival_s`: bytes arrive in bursts, so
their time is no sample time.
"""

import re
import zipfile
from pathlib import Path

import numpy as np

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.wire import keys

#: corrected rates as `truerate correct` writes them; used if the file has no readings
_CORRECTED = "rate_rad_s"
_WANTED = ("gyro_rad_s", _CORRECTED, "accel_m_s2", "temperature_c", "t_s", "rate_hz")
_BOOT = re.compile("[0-9a-f]{16}")


def read_npz(path: Path, reading: Reading) -> Table:
    """Read the wanted arrays of an .npz file. Raises RecordingError, without NumPy's advice to load unsafely."""
    if not path.stat().st_size:
        raise RecordingError(f"{path}: the file is empty: save an array 'gyro_rad_s' of shape (n, 3) with numpy.savez")
    try:
        with zipfile.ZipFile(path) as archive:  # an archive member is read only up to the size stated here
            size = sum(member.file_size for member in archive.infolist())
        if size <= MAX_BYTES:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                present = list(file.files)
                arrays = {name: file[name] for name in _WANTED if name in present}
                device, boot = (str(file[name]) if name in present else "" for name in ("device", "boot"))
    except Exception:  # noqa: BLE001 - a damaged archive fails in many ways
        raise RecordingError(
            f"{path}: not a readable .npz: damaged, of another format, or with arrays that are not plain numbers;"
            " save arrays of floats with numpy.savez"
        ) from None
    if size > MAX_BYTES:
        raise RecordingError(f"{path}: it unpacks to {size} bytes; at most {MAX_BYTES} are allowed")
    corrected = arrays.pop(_CORRECTED, None)
    if "gyro_rad_s" not in arrays and corrected is not None:
        arrays["gyro_rad_s"] = corrected
    if "gyro_rad_s" not in arrays:
        raise RecordingError(
            f"{path}: the array 'gyro_rad_s' is missing, found {', '.join(present) or 'none'}: save the rates in "
            "rad/s, shape (n, 3), under that name"
        )
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise RecordingError(f"{path}: {name!r} holds {array.dtype}, but numbers are needed: save it as float64")
    # Only device and boot in the form that an export writes are taken.
    whose = (device, int(boot, 16)) if keys.ID.match(device) and _BOOT.fullmatch(boot) else ("", 0)
    columns = {name: array.astype(np.float64, copy=False) for name, array in arrays.items()}
    notes = ["the rates are already corrected"] if "gyro_rad_s" not in present else []
    for name, factor in (("gyro_rad_s", reading.gyro_factor), ("accel_m_s2", reading.accel_factor)):
        if factor not in (None, 1.0) and name in columns:
            columns[name] = columns[name] * factor
            notes.append(f"{name!r} is read in the unit given by the option")
    if "t_s" in columns and reading.time_factor is not None:
        columns["t_s"] = columns["t_s"] * reading.time_factor
    return Table(columns, device=whose[0], boot=whose[1], notes=notes)
