"""Reader of files of an x-IMU3's data logger, which hold the messages that the device sends."""

from array import array
from math import nan, radians
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
#: messages not decoded beyond those decoded, after which a file is refused
_MOST_FAULTS = 10_000


def read(path: Path, reading: Reading) -> Table:
    """Read the inertial messages of a data logger's file as a Table, in SI units.

    Each sample has the latest temperature before it. Raises RecordingError if most messages cannot be decoded, or the
    file has no inertial message.
    """
    lines, faults, celsius = Lines(LONGEST), Tally(), nan
    times_us, numbers = array("Q"), array("d")
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
                    times_us.append(message.time_us)
                    numbers.extend((*message.gyro_dps, *message.accel_g, celsius))
                elif isinstance(message, Temperature):
                    celsius = message.celsius
            if faults.total() > len(times_us) + _MOST_FAULTS:
                raise RecordingError(f"{path}: most messages cannot be decoded: give a file of an x-IMU3's data logger")
    undecoded = ", ".join(f"{n} {label.replace('_', ' ')}" for label, n in faults.as_dict().items() if n)
    if not times_us:
        raise RecordingError(f"{path}: the file has no inertial message of an x-IMU3{undecoded and f': {undecoded}'}")
    times, rows = np.array(times_us), np.array(numbers).reshape(-1, 7)
    columns = {
        "t_s": (times - times[0]).astype(np.int64) * 1e-6,
        "gyro_rad_s": rows[:, :3] * radians(1.0),
        "accel_m_s2": rows[:, 3:6] * STANDARD_GRAVITY,
    }
    if np.isfinite(celsius):
        columns["temperature_c"] = rows[:, 6]
    notes = [f"messages not decoded: {undecoded}"] if undecoded else []
    table = table_of(path, columns, reading, tick_s=1e-6, notes=notes)
    table.model = "x-IMU3"
    return table
