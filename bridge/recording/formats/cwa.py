"""Reader of .cwa files of Axivity's AX6, by cwa-reader-rs (the extra `cwa`).

The package returns the gyro in °/s and the accelerometer in g; both are converted to SI units.
Source: https://github.com/openmovementproject/openmovement/blob/master/Docs/ax3/ax3-technical.md
"""

from math import radians
from pathlib import Path

import numpy as np
from cwa_reader_rs import read_cwa_file

from bridge.recording.error import RecordingError
from bridge.recording.formats.arrays import table_of
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.text.units import STANDARD_GRAVITY


def read(path: Path, reading: Reading) -> Table:
    """Read a .cwa file of an AX6 as a Table, in SI units.

    Raises RecordingError for a file without gyroscope readings, as an AX3 writes it.
    """
    frame = read_cwa_file(str(path), include_magnetometer=False, include_light=False, include_battery=False)
    gyro = [f"gyro_{axis}" for axis in "xyz"]
    if not set(gyro) <= set(frame.columns):
        raise RecordingError(
            f"{path}: the device recorded no gyroscope: an AX6 with its gyroscope switched on is needed"
        )
    time = frame.index.to_numpy()
    columns = {
        "t_s": (time - time[0]) / np.timedelta64(1, "s"),
        "gyro_rad_s": frame[gyro].to_numpy(np.float64) * radians(1.0),
        "accel_m_s2": frame[[f"acc_{axis}" for axis in "xyz"]].to_numpy(np.float64) * STANDARD_GRAVITY,
        "temperature_c": frame["temperature"].to_numpy(np.float64),
    }
    return table_of(path, columns, reading)
