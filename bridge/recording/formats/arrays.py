"""Makes a Table from arrays in SI units, named as in an .npz file; options can state other units."""

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.reading import Reading
from bridge.recording.table import Table

#: corrected rates as `truerate correct` writes them; used if the file has no readings
_CORRECTED = "rate_rad_s"
WANTED = ("gyro_rad_s", _CORRECTED, "accel_m_s2", "temperature_c", "t_s", "rate_hz")


def table_of(
    path: Path,
    arrays: Mapping[str, NDArray[np.generic]],
    reading: Reading,
    present: Collection[str] = (),
    *,
    tick_s: float = 0.0,
    notes: Collection[str] = (),
) -> Table:
    """Make a Table from arrays whose names are in WANTED, in SI units unless options of `reading` state others.

    arrays: by name; gyro_rad_s or rate_rad_s (n, 3) is required. The others have the shapes of `Table.columns`.
    present: names of all arrays of the file, for the error message.
    tick_s: duration of one count of the file's time column, s; 0 if unknown. notes: sentences for the user; more are
    added.
    Raises RecordingError if the array of rates is missing, an array does not hold numbers, or the arrays are too large.
    """
    arrays = dict(arrays)
    corrected = arrays.pop(_CORRECTED, None)
    said = list(notes)
    if "gyro_rad_s" not in arrays and corrected is not None:
        arrays["gyro_rad_s"] = corrected
        said.append("the rates are already corrected")
    if "gyro_rad_s" not in arrays:
        raise RecordingError(
            f"{path}: the array 'gyro_rad_s' is missing, found {', '.join(present) or 'none'}: save the rates in "
            "rad/s, shape (n, 3), under that name"
        )
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise RecordingError(f"{path}: {name!r} holds {array.dtype}, but numbers are needed: save it as float64")
    if (size := sum(array.size for array in arrays.values()) * 8) > MAX_BYTES:  # small numbers grow to float64
        raise RecordingError(
            f"{path}: its arrays take {size} bytes as float64; at most {MAX_BYTES} are allowed: split the file"
        )
    columns = {name: array.astype(np.float64, copy=False) for name, array in arrays.items()}
    for name, factor in (("gyro_rad_s", reading.gyro_factor), ("accel_m_s2", reading.accel_factor)):
        if factor not in (None, 1.0) and name in columns:
            columns[name] = columns[name] * factor
            said.append(f"{name!r} is read in the unit given by the option")
    if "t_s" in columns and reading.time_factor is not None:
        columns["t_s"] = columns["t_s"] * reading.time_factor
    return Table(columns, notes=said, tick_s=tick_s)
