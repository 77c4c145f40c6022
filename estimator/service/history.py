"""History of one device, read from the store: calibrations, boots, commands, placements, and the bias over time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import Calibration, Floats, Placement
from estimator.database import Row
from estimator.service.store_reader import StoreReader
from estimator.service.store_rows import read_sentences

_SPAN = re.compile(r"(\d+(?:\.\d+)?)\s*([smhdw])\Z")
_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 604800}


@dataclass(frozen=True, slots=True, eq=False)
class Biases:
    """Tracked bias of one boot at m points in time, oldest first.

    time_ns (m,): host time, ns since the Unix epoch. bias, std (m, 3): bias in the sensor frame and its standard
    deviation, rad/s.
    temperature_c (m,): temperature, °C, NaN where unknown. boot: boot id as text.
    """

    boot: str
    time_ns: NDArray[np.int64]
    bias: Floats
    std: Floats
    temperature_c: Floats


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """History of one device, every list oldest first.

    `boots` and `commands` are rows of the store's tables `boots` and `audit`; the `message` of a command is Sentences.
    `biases`: one element for each boot. `placements`: where and by whom the device was worn.
    """

    device: str
    calibrations: Sequence[Calibration]
    boots: Sequence[Row]
    commands: Sequence[Row]
    biases: Sequence[Biases]
    placements: Sequence[Placement] = ()

    def __bool__(self) -> bool:
        return bool(self.calibrations or self.boots or self.commands or self.biases or self.placements)


def read(store: StoreReader, device: str, since_ns: int = 0) -> History:
    """Read the history of a device from the store: calibrations, boots, commands, biases and placements.

    since_ns: start, ns since the Unix epoch by the host's clock; the placement valid at that time is included. Raises
    StoreError if the store cannot be read.
    """
    where, values, order = "device = ? AND time_ns >= ?", (device, since_ns), "time_ns, rowid"
    points: dict[str, list[Row]] = {}
    for row in store.database.rows("bias_history", where, values, order):
        points.setdefault(row["boot"], []).append(row)
    return History(
        device,
        [c for c in store.calibrations(device) if c.time_ns >= since_ns],
        store.database.rows("boots", where, values, order),
        [
            row | {"message": read_sentences(row["message"])}
            for row in store.database.rows("audit", where, values, order)
        ],
        [_biases(boot, rows) for boot, rows in points.items()],
        _placements(store, device, since_ns),
    )


def _placements(store: StoreReader, device: str, since_ns: int) -> list[Placement]:
    """Placements from a time on, and the one that held then."""
    found = store.placements(device)
    later = [one for one in found if one.since_ns >= since_ns]
    return found[len(found) - len(later) - 1 :] if len(later) < len(found) else later


def ahead(found: History, now_ns: int) -> int:
    """Count the records of a history that are dated after `now_ns`, ns since the Unix epoch.

    A record dated in the future shows that the clock was wrong when it was written, or is wrong now.
    """
    times = [c.time_ns for c in found.calibrations] + [row["time_ns"] for row in (*found.boots, *found.commands)]
    times += [time_ns for of in found.biases for time_ns in of.time_ns.tolist()]
    return len([time_ns for time_ns in times if time_ns > now_ns])


def since(text: str, now: datetime) -> datetime:
    """Parse a start time: `7d`, `12h` or `30m` before `now`, or a date with or without a time of day.

    now: datetime with time zone. A date without a zone is in this machine's zone. Raises ValueError, which states the
    accepted forms.
    """
    if match := _SPAN.match(text.strip()):
        try:
            return now - timedelta(seconds=float(match[1]) * _SECONDS[match[2]])
        except OverflowError:
            raise ValueError(f"{text!r} is too long ago: give a time after the year 1") from None
    try:
        found = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f"invalid time {text!r}: use 7d, 12h, 30m, 2026-03-01 or 2026-03-01T14:30") from None
    return found if found.tzinfo else found.astimezone()  # with the zone's offset on that date


def _biases(boot: str, rows: list[Row]) -> Biases:
    def column(*names: str) -> Floats:
        return np.array([[np.nan if row[name] is None else row[name] for name in names] for row in rows], float)

    times = np.array([row["time_ns"] for row in rows], np.int64)
    return Biases(boot, times, column("x", "y", "z"), column("x_std", "y_std", "z_std"), column("temperature_c")[:, 0])
