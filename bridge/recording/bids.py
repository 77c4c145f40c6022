"""Exports recordings as a BIDS-Motion dataset (Brain Imaging Data Structure).

Each device is a tracking system; each boot of a device is a run. Sources: https://bids-specification.readthedocs.io,
"Motion"; Jeung et al., Scientific Data 11, 2024.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.recording.column_files import AXES, rows_of
from bridge.recording.error import RecordingError
from bridge.recording.export import BEGIN, BOOT, events, make_folder
from bridge.recording.files import check_new, new_file
from bridge.recording.stretches import Recorded, Stretch

BIDS_VERSION = "1.10.0"
LABEL = re.compile(r"[0-9a-zA-Z]+\Z")
_NONE = "n/a"
_FILES = ("motion.tsv", "motion.json", "channels.tsv", "channels.json")
_EVENTS = ("events.tsv", "events.json")

#: channels: name, column of a stretch, BIDS type, units, description
_CHANNELS = (
    ("time", "t_s", "LATENCY", "s", "since the first sample, device clock"),
    ("gyro", "gyro_rad_s", "GYRO", "rad/s", "angular rate as read"),
    ("accel", "accel_m_s2", "ACCEL", "m/s^2", "acceleration as read"),
    ("rate", "rate_rad_s", "GYRO", "rad/s", "angular rate, corrected"),
    ("ratestd", "rate_std_rad_s", "MISC", "rad/s", "its standard deviation"),
    ("quat", "quat_wxyz", "ORNT", _NONE, "attitude, sensor to earth axes with z up"),
    ("tiltstd", "tilt_std", "MISC", "rad", "standard deviation of the tilt"),
    ("headingstd", "heading_std", "MISC", "rad", "standard deviation of the heading"),
    ("temperature", "temperature_c", "MISC", "oC", "of the sensor"),
    (
        "quality",
        "quality",
        "MISC",
        _NONE,
        "of the corrected rate: 0 none, 1 prior, 2 bias only, 3 good, 4 degraded, -1 not corrected",
    ),
)


@dataclass(frozen=True, slots=True)
class Channel:
    """Column of a BIDS motion file: name, component (axis), type, unit and description, as BIDS defines them.

    values (n,): in the unit `units`.
    """

    name: str
    component: str
    type: str
    units: str
    description: str
    values: NDArray[np.generic]


@dataclass(frozen=True, slots=True)
class Session:
    """Labels of a BIDS session: subject, task and, if any, session. Never use a person's name.

    Raises RecordingError for a label with other characters than letters and digits.
    """

    subject: str
    task: str
    session: str = ""

    def __post_init__(self) -> None:
        for key, label in (("--subject", self.subject), ("--task", self.task), ("--session", self.session or "none")):
            if not LABEL.match(label):
                raise RecordingError(f"{key} {label!r}: BIDS allows only letters and digits; use for example 01")

    @property
    def stem(self) -> str:
        """First part of every file name of the session, such as sub-01_ses-02."""
        return f"sub-{self.subject}" + (f"_ses-{self.session}" if self.session else "")

    @property
    def folder(self) -> Path:
        """Folder of the session, relative to the dataset, such as sub-01/ses-02."""
        return Path(f"sub-{self.subject}", *([f"ses-{self.session}"] if self.session else []))


def export_bids(recorded: Recorded, folder: Path, session: Session) -> list[Path]:
    """Write a BIDS-Motion dataset, or add a subject to an existing one; returns the motion and event files written.

    folder: folder of the dataset. Raises RecordingError if a file of the session exists already, if two devices get the
    same label, or if the folder cannot be made.
    """
    systems = _systems(list(recorded.stretches))
    home = folder / session.folder
    make_folder(folder)
    (home / "motion").mkdir(parents=True, exist_ok=True)
    stems = {
        f"{session.stem}_task-{session.task}_tracksys-{systems[device]}"
        + (f"_run-{stretch.number}" if len(stretches) > 1 else ""): stretch
        for device, stretches in recorded.stretches.items()
        for stretch in stretches
    }
    check_new(home / "motion" / f"{stem}_{name}" for stem in stems for name in (*_FILES, *_EVENTS))
    listed, people = home / f"{session.stem}_scans.tsv", folder / "participants.tsv"
    known_scans, known_people = _lines(listed, ("filename", "acq_time")), _lines(people, ("participant_id",))
    paths, scans = [], []
    for stem, stretch in stems.items():
        paths += _write(home / "motion", stem, stretch, session.task, systems[stretch.device])
        began = datetime.fromtimestamp(int(stretch.time_ns[0]) / 1e9, UTC)
        scans.append((f"motion/{stem}_motion.tsv", f"{began:%Y-%m-%dT%H:%M:%S.%f}Z"))
        paths += _write_events(home / "motion", stem, recorded, stretch)
    _add_rows(listed, known_scans, scans)
    _add_rows(people, known_people, [(f"sub-{session.subject}",)])
    about = folder / "dataset_description.json"
    if not about.exists():
        made_by = {"Name": "truerate", "Version": version("truerate")}
        told = {
            "Name": "Recorded by truerate",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "GeneratedBy": [made_by],
        }
        _write_json(about, told)
        if not any(folder.glob("README*")):
            with new_file(folder / "README") as file:
                file.write(_README.encode())
    return paths


def channels(stretch: Stretch) -> list[Channel]:
    """Return the columns of the motion file of a stretch (samples of one boot), in the order of the file.

    Units: s for times, rad/s for rates, m/s² for accelerations, rad for standard deviations of angles, °C.
    """
    there, found = stretch.columns, list[Channel]()
    for name, column, kind, units, words in _CHANNELS:
        if (values := there.get(column)) is None:
            continue
        axes = {1: (_NONE,), 3: tuple(AXES), 4: tuple(f"quat_{part}" for part in "wxyz")}[values[0].size]
        for axis, single in zip(axes, np.atleast_2d(values.T), strict=True):
            full = axis if name == "quat" else name if axis == _NONE else f"{name}_{axis}"
            found.append(Channel(full, axis, kind, units, words, single))
    return found


def sidecar(stretch: Stretch, task: str, system: str) -> dict[str, Any]:
    """Return the content of a stretch's *_motion.json file, by BIDS field; a stretch has the samples of one boot.

    task: BIDS label of the task. system: label of the tracking system (device).
    """
    found = channels(stretch)
    counts = {
        f"{kind}ChannelCount": sum(c.type == kind for c in found) for kind in ("ACCEL", "GYRO", "LATENCY", "MISC")
    }
    seconds = float(stretch.time_s[-1])
    info = stretch.info
    about: dict[str, Any] = {
        "TaskName": task,
        "TrackingSystemName": system,
        "SamplingFrequency": stretch.rate_hz,
        "SamplingFrequencyEffective": (len(stretch) - 1) / seconds if seconds else stretch.rate_hz,
        "RecordingType": "continuous",
        "RecordingDuration": seconds,
        "MotionChannelCount": len(found),
        "TrackedPointsCount": 1,
        "MissingValues": _NONE,
        "SpatialAxes": _NONE,
        **counts,
    }
    if info is not None:
        about |= {"ManufacturersModelName": info.model, "SoftwareVersions": info.firmware}
    return about


def _write(folder: Path, stem: str, stretch: Stretch, task: str, system: str) -> list[Path]:
    found = channels(stretch)
    paths = [folder / f"{stem}_{name}" for name in _FILES]
    with new_file(paths[0]) as file:
        for _, text in rows_of([channel.values for channel in found], "\t", _NONE):
            file.write(text.encode())
    _write_json(paths[1], sidecar(stretch, task, system))
    heads = [
        "name",
        "component",
        "type",
        "tracked_point",
        "units",
        "placement",
        "reference_frame",
        "sampling_frequency",
        "description",
    ]
    worn = str(stretch.placements[-1]) if stretch.placements else _NONE
    told = [
        (c.name, c.component, c.type, stretch.device, c.units, worn, "sensor" if c.component != _NONE else _NONE,
         f"{stretch.rate_hz:g}", c.description)
        for c in found
    ]  # fmt: skip
    _write_table(paths[2], heads, told)
    _write_json(paths[3], {"reference_frame": {"Levels": {"sensor": {"Description": "the sensor's own axes"}}}})
    return paths


def _write_events(folder: Path, stem: str, recorded: Recorded, stretch: Stretch) -> list[Path]:
    """Write the notes and calibrations made during a stretch; no file if there are none."""
    first, last = int(stretch.time_ns[0]), int(stretch.time_ns[-1])
    rows = [
        (f"{(event.time_ns - first) * 1e-9:.3f}", _NONE, event.event.split()[0], f"{event.event}: {event.text}")
        for event in events(recorded)
        if event.device == stretch.device and event.event not in (BOOT, BEGIN) and first <= event.time_ns <= last
    ]
    paths = [folder / f"{stem}_{name}" for name in _EVENTS] if rows else []
    if rows:
        _write_table(paths[0], ("onset", "duration", "trial_type", "description"), rows)
        _write_json(paths[1], {"description": {"Description": "text of the note, or result of the calibration"}})
    return paths


def _systems(devices: Sequence[str]) -> dict[str, str]:
    """Return a BIDS label for each device: its letters and digits. Raises RecordingError if two labels are equal."""
    systems = {device: re.sub(r"[^0-9a-zA-Z]", "", device) for device in devices}
    taken: dict[str, str] = {}
    for device, label in systems.items():
        if label in taken:
            raise RecordingError(
                f"{taken[label]} and {device} are both {label!r} in BIDS, which allows only letters and"
                " digits: export them separately with --device"
            )
        taken[label] = device
    return systems


def _write_json(path: Path, content: dict[str, Any]) -> None:
    with new_file(path) as file:
        file.write((json.dumps(content, indent=2) + "\n").encode())


def _write_table(path: Path, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    with new_file(path) as file:
        file.write("".join("\t".join(row) + "\n" for row in (heads, *rows)).encode())


def _lines(path: Path, heads: Sequence[str]) -> list[str]:
    """Return the lines of an existing table, or the header of a new one. Raises RecordingError if it is not UTF-8."""
    try:
        known = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    except UnicodeDecodeError:
        raise RecordingError(
            f"{path}: not UTF-8, which BIDS requires: save the file as UTF-8, or move it away"
        ) from None
    return known or ["\t".join(heads)]


def _add_rows(path: Path, known: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Append the rows whose first column is not yet in the table."""
    had = {line.split("\t", 1)[0] for line in known}
    width = known[0].count("\t") + 1
    new = ["\t".join((*row, *[_NONE] * (width - len(row)))) for row in rows if row[0] not in had]
    with new_file(path, replace=True) as file:
        file.write("".join(line + "\n" for line in (*known, *new)).encode())


_README = """Recorded by truerate: each tracking system is one wearable IMU, each run one boot of it.

In *_motion.tsv, gyro and accel are readings; rate is the angular rate corrected by calibration and bias tracking, ratestd its
standard deviation, quality how far it can be trusted (see *_channels.tsv). Missing samples have no row: see the time column.
"""
