"""Reads a sequence of EuRoC MAV or TUM VI: a folder with `mav0/imu0/data.csv`, which is a text table.

Sources: Burri et al., The EuRoC micro aerial vehicle datasets, 2016; Schubert et al., The TUM VI benchmark, 2018.
"""

from pathlib import Path

from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.recording.text import reader


def read(path: Path, reading: Reading) -> Table:
    """Read one IMU of a sequence. Raises RecordingError."""
    own = path / "data.csv"
    imus = (
        {path.name: own} if own.is_file() else {one.parent.name: one for one in sorted(path.glob("**/imu*/data.csv"))}
    )
    return reader.read(choose(path, imus, reading.device, "IMUs"), reading)
