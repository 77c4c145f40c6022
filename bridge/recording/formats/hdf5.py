"""Reader and writer of HDF5 files, by h5py (the extra `hdf5`): truerate's own layout, and that of APDM's Opal.

Own layout: datasets at the root, named and shaped as the arrays of an .npz file.
APDM, version 5: /Sensors/ID with Gyroscope (n, 3) rad/s, Accelerometer (n, 3) m/s², Temperature (n,) °C, Time (n,) µs.
The label is the attribute `Label 0` of Configuration.
APDM, versions 2 to 4: /ID with Time and Calibrated/Gyroscopes, Accelerometers and Temperature. The labels are the
attributes CaseIdList and MonitorLabelList of the root.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.formats.arrays import WANTED, table_of
from bridge.recording.formats.npz import origin
from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table

Array = NDArray[np.generic]
#: names of an Opal's datasets in both layouts
_OPAL = (
    {"gyro_rad_s": "Gyroscope", "accel_m_s2": "Accelerometer", "temperature_c": "Temperature", "t_s": "Time"},
    {
        "gyro_rad_s": "Calibrated/Gyroscopes",
        "accel_m_s2": "Calibrated/Accelerometers",
        "temperature_c": "Calibrated/Temperature",
        "t_s": "Time",
    },
)


def read(path: Path, reading: Reading) -> Table:
    """Read truerate's own arrays, or one sensor of an Opal's file, as a Table in SI units.

    `reading.device` names the sensor by its label. Raises RecordingError for a damaged file, an unknown layout, or if
    the file has several sensors and none is named.
    """
    with h5py.File(path, "r") as file:
        if opals := _opals(file):
            return _opal(path, choose(path, opals, reading.device, "sensors"), reading)
        arrays = {name: _array(path, file[name]) for name in WANTED if name in file}
        table = table_of(path, arrays, reading, list(file))
        table.device, table.boot = origin(
            *(_text(_array(path, file[name])[()]) if name in file else "" for name in ("device", "boot"))
        )
    return choose(path, {table.device: table}, reading.device, "devices") if table.device else table


def write(file: IO[bytes], arrays: Mapping[str, Array]) -> None:
    """Write arrays of any shape, by name, as datasets at the root of a new HDF5 file."""
    with h5py.File(file, "w") as out:
        for name, array in arrays.items():
            if array.dtype.kind == "U":
                out.create_dataset(name, data=array.astype(object), dtype=h5py.string_dtype())
            else:
                out.create_dataset(name, data=array, compression="gzip" if array.ndim else None)


def holds(path: Path, name: str) -> bool:
    """Return True if a file has a dataset of this name; False if the file is not HDF5."""
    try:
        with h5py.File(path, "r") as file:
            return name in file
    except OSError:
        return False


def _opals(file: Any) -> dict[str, Any]:
    """Return the sensors of an Opal's file by label; sensors of one label by label and id."""
    if "Sensors" in file:
        sensors = {name: group for name, group in file["Sensors"].items() if "Gyroscope" in group}
        labels = {name: _text(group["Configuration"].attrs.get("Label 0", "")) for name, group in sensors.items()}
    else:
        groups = {name: group for name, group in file.items() if isinstance(group, h5py.Group)}
        sensors = {name: group for name, group in groups.items() if _OPAL[1]["gyro_rad_s"] in group}
        ids, known = ([_text(one) for one in file.attrs.get(key, ())] for key in ("CaseIdList", "MonitorLabelList"))
        labels = dict(zip(ids, known, strict=False))
    said = [labels.get(name) or name for name in sensors]
    return {
        label if said.count(label) == 1 else f"{label} {name}": group
        for label, (name, group) in zip(said, sensors.items(), strict=True)
    }


def _opal(path: Path, sensor: Any, reading: Reading) -> Table:
    names = next(one for one in _OPAL if one["gyro_rad_s"] in sensor)
    arrays = {ours: _array(path, sensor[theirs]) for ours, theirs in names.items() if theirs in sensor}
    if "t_s" in arrays:
        time_us = arrays["t_s"].astype(np.int64)
        arrays["t_s"] = (time_us - time_us[0]) * 1e-6
    for name, array in arrays.items():
        if array.ndim == 2 and array.shape[0] in {1, 3} and array.shape[1] != 3:
            arrays[name] = array.T
    if "temperature_c" in arrays:
        arrays["temperature_c"] = arrays["temperature_c"].reshape(-1)
    return table_of(path, arrays, reading, tick_s=1e-6, notes=["read as APDM's Opal"])


def _array(path: Path, dataset: Any) -> Array:
    elsewhere = dataset.file.filename != str(path) or dataset.external or dataset.is_virtual
    if elsewhere:  # a file from others could otherwise copy any file that its reader may read
        raise RecordingError(f"{path}: {dataset.name!r} refers to another file: copy the values into this file")
    if dataset.size * dataset.dtype.itemsize > MAX_BYTES:
        raise RecordingError(
            f"{path}: {dataset.name!r} has {dataset.size} values, which need more than {MAX_BYTES} bytes: split the file"
        )
    array: Array = dataset[()]
    return np.asarray(array)


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
