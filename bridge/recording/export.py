"""Exports recordings as .npz or .csv, one file per device and boot; `bridge.recording.load` reads the files back.

.npz: `t_s` (n,), `gyro_rad_s` (n, 3), `accel_m_s2` (n, 3), `temperature_c` (n,), `rate_hz`, `device` and `boot`.
Per sample also `host_time_ns`, `sequence` and `flags`, (n,) each.
If corrected rates were recorded: `rate_rad_s`, `rate_std_rad_s` and `bias_rad_s` (n, 3), and `quality` (n,). For a
sample without a corrected rate, these are NaN and the quality is -1.
If orientation was recorded: `quat_wxyz` (n, 4), scalar first, `tilt_std` and `heading_std` (n,), rad, NaN for a sample
without an orientation.

.csv: the same columns, one per axis; the quality is its number in messages.Quality.
`events.csv` lists boots, calibrations, notes and placements.
HDF5 has the arrays of .npz, Parquet the columns of .csv.
"""

import csv
import io
import re
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from bridge.reasons.catalogue import english
from bridge.recording import column_files
from bridge.recording.column_files import Columns
from bridge.recording.error import RecordingError
from bridge.recording.files import check_new, new_file
from bridge.recording.stretches import Recorded, Stretch
from bridge.wire.keys import boot_id

#: device names that could collide with another file's name: their files always carry the boot's number
_TAKEN = re.compile(r"events|.*_boot\d+")
#: event names: a boot, and a recording that begins within a boot
BOOT, BEGIN = "boot", "recording begins"


class Event(NamedTuple):
    """Boot, calibration, note or placement of a device, at one host time.

    time_ns: ns since the Unix epoch. boot: 64-bit boot number. event: kind of event, such as `note by nurse-2`.
    text: for a note its text, for a calibration the reason of its verdict. For a boot the sensor model, for a
    placement the body segment and wearer.
    """

    time_ns: int
    device: str
    boot: int
    event: str
    text: str


def export(recorded: Recorded, folder: Path, ending: str) -> list[Path]:
    """Write a recording to a folder, one file per stretch (boot of a device) and events.csv; returns the files.

    ending: format of the files, one of column_files.ENDINGS. Raises RecordingError if a file exists already or cannot
    be written.
    """
    make_folder(folder)
    named = {
        folder / f"{device}{f'_boot{stretch.number}' if numbered else ''}{ending}": stretch
        for device, stretches in recorded.stretches.items()
        for numbered in [len(stretches) > 1 or _TAKEN.fullmatch(device)]
        for stretch in stretches
    }
    paths = [*named, folder / "events.csv"]
    check_new(paths)
    for path, stretch in named.items():
        with new_file(path) as file:
            column_files.write(file, ending, stretch.columns, facts(stretch))
    with new_file(paths[-1]) as file:
        _write_events(file, recorded)
    return paths


def make_folder(folder: Path) -> None:
    """Make a folder inside an existing folder, unless it exists. Raises RecordingError if it cannot be made."""
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise RecordingError(
            f"{folder}: the folder {folder.parent} does not exist; make it: mkdir -p {folder.parent}"
        ) from None
    except OSError as error:
        raise RecordingError(f"{folder}: the folder cannot be made: {error.strerror}; give another folder") from None


def events(recorded: Recorded) -> list[Event]:
    """Return the boots, calibrations, notes and placements of a recording as events, in order of time.

    A boot that began before the recording has the event BEGIN instead of BOOT.
    """
    boots = [
        Event(int(s.time_ns[0]), s.device, s.boot, BOOT if _from_its_boot(s) else BEGIN, s.info.model if s.info else "")
        for stretches in recorded.stretches.values()
        for s in stretches
    ]
    calibrations = [
        Event(c.time_ns, c.device, c.boot, f"calibration {c.verdict.name.lower()}", english(*c.reason))
        for c in recorded.calibrations
    ]
    notes = [Event(n.time_ns, n.device, n.boot, f"note by {n.who}", n.text) for n in recorded.notes]
    worn = [
        Event(max(one.since_ns, int(s.time_ns[0])), s.device, s.boot, f"placement by {one.who}", str(one))
        for stretches in recorded.stretches.values()
        for s in stretches
        for one in s.placements
    ]
    return sorted(boots + calibrations + notes + worn)


def _from_its_boot(stretch: Stretch) -> bool:
    return int(stretch.sequence[0]) == 0


def facts(stretch: Stretch) -> Columns:
    """Return facts about a whole stretch (samples of one boot), by name, as arrays of shape ().

    device: id. boot: 16 hexadecimal digits. rate_hz: output data rate, Hz; left out if unknown.
    """
    told: Columns = {"device": np.array(stretch.device), "boot": np.array(boot_id(stretch.boot))}
    return {**told, "rate_hz": np.array(stretch.rate_hz)} if stretch.rate_hz else told


def _write_events(file: BinaryIO, recorded: Recorded) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("host_time_ns", "t_s", "device", "boot", "event", "text"))
    for event in events(recorded):
        since_s = f"{(event.time_ns - recorded.begin_ns) * 1e-9:.3f}"
        rows.writerow((event.time_ns, since_s, event.device, boot_id(event.boot), event.event, harmless(event.text)))
    text.detach()


def harmless(text: str) -> str:
    """Return a text that a spreadsheet does not treat as a formula.

    A quote is put before a text that begins with `=`, `+`, `-` or `@`.
    """
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text
