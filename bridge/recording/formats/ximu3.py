"""Reads the files of an x-IMU3's data logger: the device's messages as it sends them."""

from math import radians
from pathlib import Path

import numpy as np

from bridge.framing.lines import Lines
from bridge.framing.packets import BadPacket
from bridge.framing.ximu3 import LONGEST, Inertial, Temperature, decode
from bridge.recording.error import RecordingError
from bridge.recording.formats.arrays import table_of
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.text.units import STANDARD_GRAVITY
from bridge.wire.refusal import Tally

_CHUNK = 1 << 16


def read(path: Path, reading: Reading) -> Table:
    """Read the inertial messages, each with the latest temperature. Raises RecordingError."""
    lines, faults, celsius = Lines(LONGEST), Tally(), np.nan
    lines.opened()
    samples, warm = list[Inertial](), list[float]()
    with path.open("rb") as file:
        while data := file.read(_CHUNK):
            for line in lines.feed(data):
                try:
                    if line.too_long:
                        raise BadPacket("line_too_long")
                    message = decode(line.data)
                except BadPacket as bad:
                    faults.add(bad.label)
                    continue
                if isinstance(message, Inertial):
                    samples.append(message)
                    warm.append(celsius)
                elif isinstance(message, Temperature):
                    celsius = message.celsius
    undecoded = ", ".join(f"{n} {label.replace('_', ' ')}" for label, n in faults.as_dict().items() if n)
    if not samples:
        raise RecordingError(f"{path}: no inertial message of an x-IMU3 is in the file{undecoded and f': {undecoded}'}")
    first_us = samples[0].time_us
    columns = {
        "t_s": np.array([one.time_us - first_us for one in samples], np.float64) * 1e-6,
        "gyro_rad_s": np.array([one.gyro_dps for one in samples]) * radians(1.0),
        "accel_m_s2": np.array([one.accel_g for one in samples]) * STANDARD_GRAVITY,
    }
    if np.isfinite(celsius):
        columns["temperature_c"] = np.array(warm)
    notes = [f"messages not decoded: {undecoded}"] if undecoded else []
    table = table_of(path, columns, reading, tick_s=1e-6, notes=notes)
    table.model = "x-IMU3"
    return table
