"""A ward as rows: the state of each device, those that need a person first. Pure: time is an argument."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import sentences_as_json
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import DeviceInfo, Quality, State, Status
from estimator.device.lifecycle import NEVER_S

#: every device's status comes once a second; after so long it is news that none does
SILENT_S = 3.5
LOW_BATTERY_PERCENT = 15.0
SILENT, UNKNOWN, TRACKING = "silent", "unknown", "tracking"
#: what needs a person most comes first
URGENCY = ("lost", SILENT, UNKNOWN, "awaiting still", "bias only", "degraded", "turning", "warming", TRACKING)
_LISTED = 20
#: bridges of which what they say of one device is kept
_BRIDGES = 8
WORDS = {state: state.name.lower().replace("_", " ") for state in State}


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """One device. `gaps` and `missing_samples` since the estimator knows it; None is not known."""

    device: str
    state: str
    reason: Sentences
    quality: str = ""
    rate_hz: float = 0.0
    gaps: int = 0
    missing_samples: int = 0
    evidence_age_s: float | None = None
    battery_percent: float | None = None
    charging: bool = False
    notices: Sentences = ()

    @property
    def low_battery(self) -> bool:
        """Whether it will soon be off."""
        return self.battery_percent is not None and self.battery_percent < LOW_BATTERY_PERCENT and not self.charging

    @property
    def order(self) -> tuple[int, int, str]:
        """By what needs a person first."""
        urgency = URGENCY.index(self.state)
        if self.low_battery:
            urgency = min(urgency, URGENCY.index("awaiting still"))
        return urgency, not self.notices, self.device

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        said = {"reason": sentences_as_json(self.reason), "notices": sentences_as_json(self.notices)}
        return asdict(self) | said


class WardView:
    """What was said of the devices of a ward, and when."""

    def __init__(self) -> None:
        self._statuses: dict[str, tuple[Status, float]] = {}
        self._anew: set[str] = (
            set()
        )  # devices that were spoken of again: the first word may be one that the bus remembers
        self._infos: dict[str, dict[str, DeviceInfo]] = {}  # by device and bridge

    def take_status(self, status: Status, now: float) -> None:
        """The estimator's word on a device, heard at `now` seconds."""
        if status.device in self._statuses:
            self._anew.add(status.device)
        self._statuses[status.device] = status, now

    def take_info(self, info: DeviceInfo) -> None:
        """A bridge's word on a device."""
        known = self._infos.setdefault(info.device, {})
        known.pop(info.bridge, None)
        known[info.bridge] = info  # latest last
        if len(known) > _BRIDGES:
            status, _ = self._statuses.get(info.device, (None, 0.0))
            del known[next(one for one in known if status is None or one != status.bridge)]

    def room(self, device: str, most: int) -> bool:
        """Whether a device has a status or is known, or there are fewer than `most` of which only bridges speak."""
        known = device in self._statuses or device in self._infos
        return known or len(self._infos.keys() - self._statuses.keys()) < most

    def silences(self, now: float) -> dict[str, float]:
        """Of every device with a status the seconds since it came."""
        return {device: now - heard for device, (_, heard) in self._statuses.items()}

    def forget(self, device: str) -> None:
        """Drop a device."""
        self._statuses.pop(device, None)
        self._infos.pop(device, None)
        self._anew.discard(device)

    def rows(self, now: float) -> list[DeviceRow]:
        """Every device, those that need a person first."""
        names = self._statuses.keys() | self._infos.keys()
        return sorted((self.row(name, now) for name in names), key=lambda row: row.order)

    def settled(self, now: float) -> bool:
        """Whether of every device it is known that it is still spoken of, or is not."""
        return all(name in self._anew or _silence(now - heard) for name, (_, heard) in self._statuses.items())

    def statuses(self, now: float) -> dict[str, Status]:
        """The latest of each; a device of which no word comes any more is unknown."""
        return {name: _unless_silent(status, now - heard) for name, (status, heard) in self._statuses.items()}

    def infos(self) -> dict[str, DeviceInfo]:
        """Of each device what the bridge says that has the word."""
        owners = {name: status.bridge for name, (status, _) in self._statuses.items()}
        found = {name: self._info(name, owners.get(name, "")) for name in self._infos}
        return {name: info for name, info in found.items() if info is not None}

    def _info(self, name: str, owner: str) -> DeviceInfo | None:
        """Of the bridges that list a device the one whose samples are taken has the word, or else one that hears it."""
        known = self._infos.get(name, {})
        infos = [known[owner]] if owner in known else sorted(known.values(), key=lambda info: info.boot != 0)
        return infos[-1] if infos else None

    def row(self, name: str, now: float) -> DeviceRow:
        """One device."""
        status, heard = self._statuses.get(name, (None, now))
        info = self._info(name, status.bridge if status is not None else "")
        about: dict[str, Any] = {}
        if info is not None:
            battery = None if math.isnan(info.battery_percent) else info.battery_percent
            about = {"battery_percent": battery, "charging": info.charging, "notices": info.notices}
        trouble = () if info is None else info.trouble
        if status is None:
            reason = trouble or (Code.NO_ESTIMATOR_SPOKE(),)
            return DeviceRow(name, UNKNOWN, reason, **about)
        state, reason = WORDS[status.state], status.reason
        if silence := _silence(now - heard):
            state, reason = SILENT, silence
        else:
            reason = trouble + reason
        if clash := duplicate_bridges.found([status]):
            about["notices"] = (clash[0], *about.get("notices", ()))
        return DeviceRow(
            name,
            state,
            reason,
            status.quality.name.lower().replace("_", " "),
            status.rate_hz,
            status.events.get("gaps", 0),
            status.events.get("missing_samples", 0),
            status.evidence_age_s if status.evidence_age_s < NEVER_S else None,
            **about,
        )


def _silence(for_s: float) -> Sentences:
    """What to say where no word came for so long; nothing where that is no news."""
    return (Code.SILENT_ESTIMATOR(duration_s=f"{for_s:.0f}"),) if for_s > SILENT_S else ()


def _unless_silent(status: Status, for_s: float) -> Status:
    if not (silence := _silence(for_s)):
        return status
    quality = Quality.DEGRADED if status.quality is Quality.GOOD else status.quality
    return replace(status, state=State.UNKNOWN, quality=quality, reason=silence)


def charge_it(percent: float) -> Sentence:
    """What to say of a battery that is low."""
    return Code.LOW_BATTERY(percent=f"{percent:.0f}")


def counted(rows: Iterable[DeviceRow]) -> str:
    """How many are in which state, in words."""
    found = Counter(row.state for row in rows)
    return ", ".join(f"{found[state]} {state}" for state in URGENCY if found[state])


def head_line(rows: Sequence[DeviceRow]) -> str:
    """How many are tracking, and what the others are."""
    others = [row for row in rows if row.state != TRACKING]
    said = f"{len(rows) - len(others)} of {len(rows)} tracking"
    return f"{said}; {counted(others)}" if others else said


def chosen(rows: Iterable[DeviceRow], only: Iterable[str]) -> list[DeviceRow]:
    """The rows whose state is one of these words, or whose id matches one (* and ? stand for anything); all if there is none."""
    words = [word.lower() for word in only]
    states = {word.replace("-", " ").replace("_", " ") for word in words}
    return [row for row in rows if not words or row.state in states or any(matches(row.device, w) for w in words)]


def matches(text: str, pattern: str) -> bool:
    """Whether a text is as a pattern says: `*` stands for any characters, `?` for one. Time: the product of both lengths."""
    at = here = 0
    star, tried = -1, 0
    while here < len(text):
        if at < len(pattern) and pattern[at] == "*":
            star, tried = at, here
            at += 1
        elif at < len(pattern) and pattern[at] in ("?", text[here]):
            at += 1
            here += 1
        elif star >= 0:  # the last star takes one character more
            tried += 1
            at, here = star + 1, tried
        else:
            return False
    return not pattern[at:].strip("*")


def strangers(rows: Iterable[DeviceRow], only: Iterable[str]) -> list[str]:
    """Those of the words that are no state, and no device's that is heard."""
    devices = [row.device for row in rows]
    states = set(WORDS.values()) | {SILENT}
    return [
        word
        for word in only
        if word.lower().replace("-", " ").replace("_", " ") not in states
        and not any(matches(device, word.lower()) for device in devices)
    ]


def listed(devices: Iterable[str]) -> str:
    """By name, `ankle, chest`, and of many how many more there are."""
    names = sorted(devices)
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return f"{', '.join(names[:_LISTED])}{more}"


def age(seconds: float) -> str:
    """How long, in the largest unit of which there are two."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
