"""Reader of BIDS-Motion recordings: `*_motion.tsv` has no header; `*_channels.tsv` and `*_motion.json` describe it.

Source: https://bids-specification.readthedocs.io, "Motion".
"""

import csv
import json
from pathlib import Path

from bridge.recording.error import RecordingError
from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.recording.text import reader
from bridge.recording.text.layout import Layout

_MOTION, _NONE = "_motion.tsv", ("", "n/a")
#: folders from a motion file up to that of its dataset: motion, session, subject, dataset
_LEVELS = 4
#: the first words of column names that the reader of text tables understands
_WORDS = {"GYRO": "gyro", "ACCEL": "accel", "LATENCY": "time"}
Row = dict[str, str]


def read(path: Path, reading: Reading) -> Table:
    """Read one tracked point of a *_motion.tsv file as a Table, in SI units.

    `reading.device` names the tracked point if the file has several. Raises RecordingError if a description is missing
    or incomplete, or if there are several tracked points and none is named.
    """
    rows = _channels(path)
    points = dict[str, list[int]]()
    for at, row in enumerate(rows):
        if row["type"] == "GYRO":
            points.setdefault(row.get("tracked_point", ""), []).append(at)
    chosen = choose(path, points, reading.device, "tracked points with a gyroscope")
    point = rows[chosen[0]].get("tracked_point", "")
    names, taken = [""] * len(rows), set[str]()
    for at, row in enumerate(rows):
        kind, axis, unit = row["type"], row.get("component", "").lower(), row.get("units", "")
        name = _WORDS.get(kind, "") if kind == "LATENCY" else f"{_WORDS.get(kind, '')}_{axis}"
        mine = kind == "LATENCY" or (row.get("tracked_point", "") == point and axis in {"x", "y", "z"})
        if kind in _WORDS and mine and name not in taken:  # of several vectors of a point, the first
            taken.add(name)
            names[at] = name if unit in _NONE else f"{name} ({unit})"
    layout = Layout("\t", ".", names, len(names), 0, _rate(path, rows[chosen[0]]))
    table = reader.read(path, reading, layout)
    if left := [rows[at]["name"] for at in chosen if not names[at]]:
        table.notes.append(f"{', '.join(left)}: not used; truerate reads only the first rates of a tracked point")
    return table


def _channels(path: Path) -> list[Row]:
    sidecar = _sidecar(path, "channels.tsv")
    if sidecar is None:
        raise RecordingError(
            f"{path}: the file *_channels.tsv with the column names is missing: copy it from the dataset"
        )
    with sidecar.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    if not rows or not {"name", "type"} <= set(rows[0]):
        raise RecordingError(
            f"{sidecar}: the columns name, component, type, tracked_point and units are needed: copy the file from "
            "the dataset again"
        )
    return rows


def _rate(path: Path, channel: Row) -> float:
    """Return the sampling frequency, Hz: of the channel, else of the sidecar; 0 if neither states a number."""
    said: object = channel.get("sampling_frequency", "")
    if said in _NONE and (sidecar := _sidecar(path, "motion.json")) is not None:
        try:
            said = json.loads(sidecar.read_text(encoding="utf-8-sig")).get("SamplingFrequency")
        except (ValueError, AttributeError):
            raise RecordingError(f"{sidecar}: not a JSON object: take the file from the dataset again") from None
    try:
        return float(str(said))
    except ValueError:
        return 0.0


def _sidecar(path: Path, ending: str) -> Path | None:
    """Return the nearest file that describes `path`: in its folder, else in one above, up to the dataset's own.

    By the inheritance principle a file above applies if its entities, such as task-walk, are all in the name.
    """
    entities = set(path.name[: -len(_MOTION)].split("_"))
    for folder in path.absolute().parents[:_LEVELS]:
        fitting = [
            one
            for one in folder.glob(f"*{ending}")
            if set(one.name[: -len(ending)].strip("_").split("_")) <= {*entities, ""}
        ]
        if fitting:
            return max(fitting, key=lambda one: len(one.name))
        if (folder / "dataset_description.json").exists():
            break
    return None
