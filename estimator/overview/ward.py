"""View of a ward as rows: the state of each device, most urgent first. Pure: time is an argument."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import sentences_as_json
from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import DeviceInfo, Placement, Quality, State, Status
from estimator.device.attention import LOW_BATTERY_PERCENT, complaints, ended, needs_person
from estimator.device.lifecycle import NEVER_S

#: seconds without a status after which a device counts as silent; a status comes once a second
SILENT_S = 3.5
SILENT, UNKNOWN, TRACKING, ENDED = "silent", "unknown", "tracking", "ended"
#: states, most urgent first
URGENCY = ("lost", SILENT, UNKNOWN, "awaiting still", "bias only", "degraded", "turning", "warming", TRACKING, ENDED)
#: of a device that tracks and yet needs a person
_ASKS = URGENCY.index("awaiting still")
#: states of devices that wait for turns by hand
_WAIT = ("awaiting still", "bias only", "warming", "turning")
_LISTED = 20
#: most bridges per device whose info is kept
_BRIDGES = 8
WORDS = {state: state.name.lower().replace("_", " ") for state in State}


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """Row of one device in a list of a ward: state, reasons, quality, rate and battery.

    rate_hz: measured samples per second; 0 if unknown. evidence_age_s: seconds since the last accepted rest, None
    without one.
    `gaps`, `missing_samples`: numbers of gaps and of samples missing in them, since the estimator first saw the device.
    battery_percent: charge, 0 to 100, None if unknown. notices: other messages, such as a low battery.
    needs_person: as `estimator.device.attention` defines it; also True if no estimator reports the device.
    """

    device: str
    state: str
    reason: Sentences
    needs_person: bool = True
    quality: str = ""
    rate_hz: float = 0.0
    gaps: int = 0
    missing_samples: int = 0
    evidence_age_s: float | None = None
    battery_percent: float | None = None
    charging: bool = False
    notices: Sentences = ()
    placement: Placement | None = None

    @property
    def low_battery(self) -> bool:
        """True if the battery's charge is below LOW_BATTERY_PERCENT and the battery is not charging."""
        return self.battery_percent is not None and self.battery_percent < LOW_BATTERY_PERCENT and not self.charging

    @property
    def order(self) -> tuple[int, bool, str]:
        """Sort key of the rows: most urgent first, then rows with notices, then by device id.

        The second element is True for a row without notices.
        """
        urgency = URGENCY.index(self.state)
        if self.needs_person and self.state == TRACKING:
            urgency = min(urgency, _ASKS)
        return urgency, not self.notices, self.device

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON-compatible values, by field name."""
        said = {"reason": sentences_as_json(self.reason), "notices": sentences_as_json(self.notices)}
        return asdict(self) | said


class WardView:
    """Latest status of each device of a ward, when it arrived (monotonic time), and the latest infos by bridge."""

    def __init__(self) -> None:
        self._statuses: dict[str, tuple[Status, float]] = {}
        self._anew: set[str] = set()  # devices with a second status, as the bus may have kept an old first one
        self._infos: dict[str, dict[str, DeviceInfo]] = {}  # by device and bridge

    def take_status(self, status: Status, now: float) -> None:
        """Keep a status of a device, received at monotonic time `now`, s."""
        if status.device in self._statuses:
            self._anew.add(status.device)
        self._statuses[status.device] = status, now

    def take_info(self, info: DeviceInfo) -> None:
        """Keep a bridge's info of a device, for at most eight bridges per device."""
        known = self._infos.setdefault(info.device, {})
        known.pop(info.bridge, None)
        known[info.bridge] = info  # latest last
        if len(known) > _BRIDGES:
            status, _ = self._statuses.get(info.device, (None, 0.0))
            del known[next(one for one in known if status is None or one != status.bridge)]

    def room(self, device: str, most: int) -> bool:
        """Return whether there is room for infos of a device.

        True for a known device, or if fewer than `most` devices are known from bridges only.
        """
        known = device in self._statuses or device in self._infos
        return known or len(self._infos.keys() - self._statuses.keys()) < most

    def silences(self, now: float) -> dict[str, float]:
        """Return the seconds since the last status of each device, by device id. now: monotonic s."""
        return {device: now - heard for device, (_, heard) in self._statuses.items()}

    def ended(self, now: float) -> list[str]:
        """Return the ids of devices whose data has ended, and of which no status has arrived for SILENT_S seconds.

        now: monotonic time, s.
        """
        return [
            device
            for device, (status, heard) in self._statuses.items()
            if now - heard > SILENT_S and ended(status.reason)
        ]

    def forget(self, device: str) -> None:
        """Drop everything known about a device."""
        self._statuses.pop(device, None)
        self._infos.pop(device, None)
        self._anew.discard(device)

    def rows(self, now: float) -> list[DeviceRow]:
        """Return the rows of all devices, most urgent first. now: monotonic time, s."""
        names = self._statuses.keys() | self._infos.keys()
        return sorted((self.row(name, now) for name in names), key=lambda row: row.order)

    def settled(self, now: float) -> bool:
        """Return whether every device is known to be live (a second status came) or silent (none for SILENT_S seconds).

        The first status of a device may be an old one that the bus had cached. now: monotonic time, s.
        """
        return all(name in self._anew or _silence(now - heard) for name, (_, heard) in self._statuses.items())

    def statuses(self, now: float) -> dict[str, Status]:
        """Return the latest status of each device by id; the state of a silent device becomes UNKNOWN.

        now: monotonic time, s.
        """
        return {name: _unless_silent(status, now - heard) for name, (status, heard) in self._statuses.items()}

    def infos(self) -> dict[str, DeviceInfo]:
        """Return the hardware info of each device by id, from the bridge that `info` chooses."""
        return {name: info for name in self._infos if (info := self.info(name)) is not None}

    def info(self, name: str) -> DeviceInfo | None:
        """Return the info of a device from the bridge whose samples are used, else from another bridge.

        None if unknown. Among other bridges, one that has received the device's present boot comes first.
        """
        known, (status, _) = self._infos.get(name, {}), self._statuses.get(name, (None, 0.0))
        if status is not None and status.bridge in known:
            return known[status.bridge]
        return max(reversed(known.values()), key=lambda info: info.boot != 0, default=None)

    def row(self, name: str, now: float) -> DeviceRow:
        """Return the row of one device: state, reasons and counts, from its status and info.

        now: monotonic time, s.
        """
        status, heard = self._statuses.get(name, (None, now))
        info = self.info(name)
        about: dict[str, Any] = {}
        if info is not None:
            battery = None if math.isnan(info.battery_percent) else info.battery_percent
            low = tuple(one for one in complaints(info) if one.code == Code.LOW_BATTERY)
            about = {"battery_percent": battery, "charging": info.charging, "notices": (*low, *info.notices)}
        trouble = () if info is None else info.trouble
        if status is None:
            reason = trouble or (Code.NO_ESTIMATOR_SPOKE(),)
            return DeviceRow(name, UNKNOWN, reason, **about)
        state, reason, needs = WORDS[status.state], status.reason, needs_person(status, info)
        if ended(reason):
            state = ENDED
        elif silence := _silence(now - heard):
            needs = True
            state, reason = SILENT, silence
        else:
            reason = trouble + reason
        if clash := duplicate_bridges.found([status]):
            about["notices"] = (clash[0], *about.get("notices", ()))
        return DeviceRow(
            name,
            state,
            reason,
            needs,
            status.quality.name.lower().replace("_", " "),
            status.rate_hz,
            status.events.get("gaps", 0),
            status.events.get("missing_samples", 0),
            status.evidence_age_s if status.evidence_age_s < NEVER_S else None,
            placement=status.placement,
            **about,
        )


def _silence(for_s: float) -> Sentences:
    """Return the reason for a silence of so many seconds; empty if it is short."""
    return (Code.SILENT_ESTIMATOR(duration_s=f"{for_s:.0f}"),) if for_s > SILENT_S else ()


def _unless_silent(status: Status, for_s: float) -> Status:
    if not (silence := _silence(for_s)):
        return status
    quality = Quality.DEGRADED if status.quality is Quality.GOOD else status.quality
    return replace(status, state=State.UNKNOWN, quality=quality, reason=silence)


def to_calibrate(rows: Iterable[DeviceRow]) -> list[str]:
    """Return the ids of devices that wait for turns by hand; devices whose calibration has not begun come first."""
    waits = sorted((row for row in rows if row.state in _WAIT), key=lambda row: _WAIT.index(row.state))
    return [row.device for row in waits]


def counted(rows: Iterable[DeviceRow]) -> str:
    """Format the number of devices in each state, most urgent first: `1 lost, 3 tracking`."""
    found = Counter(row.state for row in rows)
    return ", ".join(f"{found[state]} {state}" for state in URGENCY if found[state])


def head_line(rows: Sequence[DeviceRow]) -> str:
    """Format the number of tracking devices and the states of the others: `5 of 6 tracking; 1 lost`."""
    others = [row for row in rows if row.state != TRACKING]
    said = f"{len(rows) - len(others)} of {len(rows)} tracking"
    return f"{said}; {counted(others)}" if others else said


def listed(devices: Iterable[str]) -> str:
    """Format device ids in alphabetical order, `ankle, chest`; after the first 20, the number of the others."""
    names = sorted(devices)
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return f"{', '.join(names[:_LISTED])}{more}"


def age(seconds: float) -> str:
    """Format a duration by the largest unit (s, min, h, d) of which it has at least two: `3 min`.

    seconds: the duration, s.
    """
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
