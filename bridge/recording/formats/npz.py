"""Reader of NumPy's .npz files as recordings.

`gyro_rad_s` (n, 3), or else `rate_rad_s` (n, 3), is required. Optional are `accel_m_s2` (n, 3), `temperature_c` (n,),
`t_s` (n,) and `rate_hz` (). So are `device` () and `boot` (), texts as an export writes them. Other arrays are ignored.
That includes `arrival_s`, because bytes arrive in bursts: arrival times are not sample times.
"""

import re
import zipfile
from pathlib import Path

import numpy as np

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.formats.arrays import WANTED, table_of
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.wire import keys

_BOOT = re.compile("[0-9a-f]{16}")


def read(path: Path, reading: Reading) -> Table:
    """Read the arrays of an .npz file as a Table, in SI units unless options of `reading` state others.

    Read: gyro_rad_s (n, 3) or, without it, rate_rad_s (n, 3). Also, if present: accel_m_s2 (n, 3), temperature_c (n,),
    t_s (n,), and rate_hz, device and boot, each of shape ().
    Raises RecordingError for a damaged or too large file, and if the array of rates is missing.
    """
    if not path.stat().st_size:
        raise RecordingError(f"{path}: the file is empty: save an array 'gyro_rad_s' of shape (n, 3) with numpy.savez")
    try:
        with zipfile.ZipFile(path) as archive:  # an archive member is read only up to the size stated here
            size = sum(member.file_size for member in archive.infolist())
        if size <= MAX_BYTES:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                present = list(file.files)
                arrays = {name: file[name] for name in WANTED if name in present}
                device, boot = (str(file[name]) if name in present else "" for name in ("device", "boot"))
    except Exception:  # noqa: BLE001 - a damaged archive fails in many ways
        raise RecordingError(
            f"{path}: not a readable .npz: damaged, of another format, or with arrays that are not plain numbers;"
            " save arrays of floats with numpy.savez"
        ) from None
    if size > MAX_BYTES:
        raise RecordingError(
            f"{path}: the file unpacks to {size} bytes; at most {MAX_BYTES} are allowed: split the file"
        )
    table = table_of(path, arrays, reading, present)
    table.device, table.boot = origin(device, boot)
    return table


def origin(device: str, boot: str) -> tuple[str, int]:
    """Parse the device id and boot number stored in an exported file; returns "" and 0 if either is invalid.

    device: id. boot: boot number as 16 hexadecimal digits.
    """
    return (device, int(boot, 16)) if keys.ID.match(device) and _BOOT.fullmatch(boot) else ("", 0)
