"""Reader of EuRoC MAV and TUM VI sequences: a folder with `mav0/imu0/data.csv`, which is a text table.

Sources: Burri et al., The EuRoC micro aerial vehicle datasets, 2016; Schubert et al., The TUM VI benchmark, 2018.
"""

from pathlib import Path

from bridge.recording.formats.registry import EUROC_IMUS
from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.recording.text import reader


def read(path: Path, reading: Reading) -> Table:
    """Read one IMU of a sequence's folder as a Table, in SI units.

    `reading.device` names the IMU if the folder has several. Raises RecordingError if the folder has no readable IMU
    file, or has several and none is named.
    """
    imus = {one.parent.name: one for pattern in EUROC_IMUS for one in sorted(path.glob(pattern))}
    return reader.read(choose(path, imus, reading.device, "IMUs"), reading)
