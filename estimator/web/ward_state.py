"""Present state of a ward and its devices, collected from all received messages. Every page is built from it.

Pure: `now` is monotonic time, s.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import count

from bridge.reasons.codes import Code, Sentences
from bridge.wire import keys
from bridge.wire.messages import (
    Alert,
    BiasRevision,
    BootCause,
    Calibration,
    DeviceInfo,
    Note,
    Owned,
    Placement,
    State,
    Status,
    Verdict,
)
from bridge.wire.refusal import Tally
from estimator.config.alerts import DEFAULTS
from estimator.device.lifecycle import AWAY
from estimator.overview import summary as glance
from estimator.overview.summary import WardSummary
from estimator.overview.ward import SILENT, SILENT_S, UNKNOWN, WORDS, DeviceRow, WardView
from estimator.service.history import Biases, History
from estimator.web.device_trail import Mark, Trail

#: live estimators and bridges are visible within this time after a router is connected, s
LOOKED_S = 2.0
#: most devices remembered: as many as an estimator has and some; and most that only a bridge reports
DEVICES, STRANGERS = 4200, 256
#: an uncalibrated device without recent statuses is forgotten after this long, s, while other devices have statuses; so is
#: one that never had a status, and that no live bridge lists
FORGET_S = 60.0
#: most bridges named that list too many devices, and most ids whose liveliness is known
_NAMED, _TOKENS = 8, 1024
CALIBRATIONS, NOTES, BOOTS = 50, 50, 50
_CAUSES = {
    BootCause.UNKNOWN: "",
    BootCause.POWER_UP: "switched on",
    BootCause.PORT_OPENED: "port opened",
}


@dataclass(frozen=True, slots=True)
class Boot:
    """Boot (start) of a device, received live or read from the store.

    boot: its id. time_ns: host time of its first message, ns since the Unix epoch. cause: a label, empty if unknown.
    what: model and firmware.
    """

    boot: int
    time_ns: int
    cause: str
    what: str


@dataclass(slots=True)
class Story:
    """Collected messages of one device: status, info, bias trail, calibrations, boots and notes.

    Calibrations and boots are by id, oldest first. number: index of the device in the binary frames that cover all
    devices.
    """

    number: int
    status: Status | None = None
    info: DeviceInfo | None = None
    trail: Trail = field(default_factory=Trail)
    #: monotonic time of the last status with samples, s; None if there was none
    heard_s: float | None = None
    #: monotonic time since which no live bridge lists a device without a status, s; None if one does
    unlisted_s: float | None = None
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    notes: deque[Note] = field(default_factory=lambda: deque(maxlen=NOTES))
    boots: dict[int, Boot] = field(default_factory=dict)
    #: bias history of the present boot, from the store
    biases: Biases | None = None
    #: differs from that of every other story: a device that was forgotten and came back has a new one
    serial: int = field(default_factory=count().__next__)

    @property
    def boot(self) -> int:
        """Present boot id; 0 when unknown."""
        return self.status.boot if self.status else self.info.boot if self.info else 0

    def take_calibrations(self, calibrations: Iterable[Calibration]) -> None:
        """Add calibrations, accepted or rejected; the CALIBRATIONS latest and the one in use are kept.

        Each new one is also marked in the trail.
        """
        all_of_them = {one.id: one for one in (*calibrations, *self.calibrations.values())}
        found = sorted(all_of_them.values(), key=lambda one: one.time_ns)
        in_use = self.status.calibration if self.status is not None else ""
        kept = [*(one for one in found[:-CALIBRATIONS] if one.id == in_use), *found[-CALIBRATIONS:]]
        for one in kept:
            if one.id not in self.calibrations:
                kind = "calibrated" if one.verdict is Verdict.ACCEPTED else "refused"
                self.trail.mark(Mark(one.time_ns, kind, one.reason))
        self.calibrations = {one.id: one for one in kept}

    def take_note(self, note: Note) -> None:
        """Add a person's note, also to the trail; a repeat changes nothing."""
        if note not in self.notes:
            self.notes.append(note)
            self.trail.mark(Mark(note.time_ns, "note", f"{note.who}: {note.text}"))

    def hears(self, bridge: str) -> bool:
        """Return whether pages show the device's samples and infos from this bridge.

        True if the estimator uses this bridge's samples of the device, or no bridge's samples yet.
        """
        return self.status is None or not self.status.boot or self.status.bridge in {"", bridge}

    def take_boot(self, boot: Boot) -> None:
        """Add a boot; if it is known already, the earlier of the two times is kept. The BOOTS latest are kept."""
        known = self.boots.get(boot.boot)
        if known is None or boot.time_ns < known.time_ns:
            self.boots[boot.boot] = boot
            self.boots = dict(sorted(self.boots.items(), key=lambda item: item[1].time_ns)[-BOOTS:])


class Known:
    """Collected messages of a ward: devices, live bridges and estimators, alerts, and the connection to a router."""

    def __init__(self, ward: str) -> None:
        self.ward = ward
        #: settings of the alerts, with their quiet hours
        self.alert_settings = DEFAULTS
        self.connected = False
        #: whether a router was connected long enough for live estimators to be visible
        self.looked = False
        self._alone_at: float | None = None
        self.left_out = Tally()
        self.stories: dict[str, Story] = {}
        #: bridges that list more devices than fit
        self.crowding: set[str] = set()
        #: liveliness by id, for `bridge` and `estimator`; written by a thread of the bus
        self.alive: dict[str, dict[str, bool]] = {"bridge": {}, "estimator": {}}
        self._estimators = dict[str, tuple[tuple[Alert, ...], float]]()
        self._view = WardView()
        #: number of statuses and infos so far, and the summary made at that number
        self._news = 0
        self._glanced: tuple[int, dict[str, list[str]], WardSummary] | None = None

    def story(self, device: str, *, status: bool = False) -> Story | None:
        """Return the collected messages of a device, created if new; None if there is no room.

        status: whether a status of the device has arrived. Then a device without a status is forgotten to make room.
        """
        if device not in self.stories:
            if len(self.stories) >= DEVICES:
                stranger = next((name for name, story in self.stories.items() if story.status is None), None)
                if stranger is None or not status:
                    self.left_out.add("devices")
                    return None
                self._forget(stranger)
            self.stories[device] = Story(len(self.stories))
        return self.stories[device]

    def tidy(self, now: float) -> None:
        """Forget devices that have ended, that no live bridge lists, or that are silent without a calibration.

        now: monotonic time, s.
        Ended: the recording is over or the device was removed, and no status has arrived for SILENT_S seconds.
        Not listed: no status has ever arrived, and no live bridge has listed the device for FORGET_S seconds.
        Silent: no status has arrived for FORGET_S seconds, while another device sends statuses.
        """
        over, spoken = {*self._view.ended(now), *self._unlisted(now)}, self._view.silences(now)
        if spoken and min(spoken.values()) <= SILENT_S:
            for device, silent_s in spoken.items():
                status = self.stories[device].status
                if silent_s > FORGET_S and status is not None and not status.calibration:
                    over.add(device)
        if over:
            self._forget(*over)

    def _unlisted(self, now: float) -> list[str]:
        found, bridges = list[str](), self.alive["bridge"].copy()
        for device, story in self.stories.items():
            listed = story.status is not None or (story.info is not None and bridges.get(story.info.bridge, False))
            story.unlisted_s = None if listed else now if story.unlisted_s is None else story.unlisted_s
            if story.unlisted_s is not None and now - story.unlisted_s > FORGET_S:
                found.append(device)
        return found

    def _forget(self, *devices: str) -> None:
        for device in devices:
            del self.stories[device]
            self._view.forget(device)
        for number, story in enumerate(self.stories.values()):
            story.number = number
        self._news += 1

    def take_router(self, now: float, *, there: bool) -> None:
        """Record whether a router is connected (`there`) at monotonic time `now`, s."""
        self.connected = there
        if self._alone_at is None or not there:
            self._alone_at = now
        self.looked = now - self._alone_at > LOOKED_S

    def take_token(self, kind: str, name: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        """Record whether the estimator or bridge `name` is alive. The bus calls this on its own thread.

        kind: `estimator` or `bridge`. At most 1024 names of a kind are kept: a dead one is forgotten first, otherwise
        the oldest.
        """
        there = self.alive[kind]
        there[name] = alive
        if len(there) > _TOKENS:
            del there[next((name for name, alive in there.items() if not alive), next(iter(there)))]

    def take_status(self, status: Status, now: float) -> None:
        """Keep a device's status as its latest, and add it to the trail. now: monotonic time of its receipt, s."""
        if (story := self.story(status.device, status=True)) is not None:
            again, story.status = story.status is not None, status
            if again and status.state not in AWAY:  # the first status may come from the bus's cache
                story.heard_s = now
            story.trail.take(status)
            self._view.take_status(status, now)
            self._news += 1

    def take_info(self, info: DeviceInfo) -> None:
        """Keep a bridge's info about a device, and record the boot that it names.

        If several bridges list the device, its present info is the one from the bridge whose samples the estimator uses.
        """
        if not self._view.room(info.device, STRANGERS):
            self.left_out.add("devices")
            if len(self.crowding) < _NAMED:
                self.crowding.add(info.bridge)
            return
        if (story := self.story(info.device)) is None:
            return
        self._view.take_info(info)
        story.info = self._view.info(info.device)
        if info is story.info and info.boot and story.hears(info.bridge):
            what = f"{info.model} {info.firmware}".strip()
            story.take_boot(Boot(info.boot, info.time_ns, _CAUSES[info.boot_cause], what))
        self._news += 1

    def take_owned(self, owned: Owned, now: float) -> None:
        """Keep an estimator's alerts from its list of owned devices, received at monotonic time `now`, s.

        A list may come in several messages. Only part 0 contains the alerts; other parts change nothing.
        """
        if not owned.part and (owned.estimator in self._estimators or len(self._estimators) < _NAMED):
            self._estimators[owned.estimator] = owned.alerts, now

    def alerts(self, now: float) -> list[tuple[str, Placement | None, Alert]]:
        """Return (subject, placement or None, alert) for each standing alert (raised and not yet cleared).

        subject: id of the device or estimator. Alerts not acknowledged come first, and within each group the oldest.
        now: monotonic time, s.
        """
        statuses = [story.status for story in self.stories.values() if story.status is not None]
        found = [(one.device, one.placement, alert) for one in statuses for alert in one.alerts]
        for name, (alerts, heard) in self._estimators.items():
            found += [(name, None, alert) for alert in alerts if now - heard < SILENT_S]
        return sorted(found, key=lambda one: (bool(one[2].acknowledged_ns), one[2].raised_ns, one[0]))

    def take_calibration(self, calibration: Calibration) -> None:
        """Add a published calibration to its device."""
        if (story := self.story(calibration.device)) is not None:
            story.take_calibrations([calibration])

    def take_note(self, note: Note) -> None:
        """Add a published note to its device."""
        if (story := self.story(note.device)) is not None:
            story.take_note(note)

    def take_revision(self, revision: BiasRevision) -> None:
        """Replace past biases in the trail of a device by the estimator's revised values."""
        if (story := self.story(revision.device)) is not None:
            story.trail.revise(revision)

    def take_past(self, past: History) -> None:
        """Add a device's history from the store: calibrations, boots and bias. An unknown device changes nothing."""
        if (story := self.stories.get(past.device)) is None:
            return
        story.take_calibrations(past.calibrations)
        for row in past.boots:
            cause = _CAUSES.get(BootCause[row["cause"]], "") if row["cause"] in BootCause.__members__ else ""
            story.take_boot(
                Boot(int(row["boot"], 16), row["time_ns"], cause, f"{row['model']} {row['firmware']}".strip())
            )
        story.biases = next((one for one in past.biases if one.boot == keys.boot_id(story.boot)), None)

    def rows(self, now: float) -> list[DeviceRow]:
        """Return the summary rows of all devices; devices that need a person come first. now: monotonic time, s."""
        rows = self._view.rows(now)
        return rows if self.connected else sorted(map(self._unheard, rows), key=lambda row: row.order)

    def row(self, device: str, now: float) -> DeviceRow:
        """Return the summary row of a known device; its state is unknown while no router is connected.

        now: monotonic time, s.
        """
        row = self._view.row(device, now)
        return row if self.connected else self._unheard(row)

    def _unheard(self, row: DeviceRow) -> DeviceRow:
        """The row while nothing can be heard: state unknown, never lost."""
        status = self.stories[row.device].status
        known = status is not None and status.state is not State.UNKNOWN
        last = (Code.LAST_STATE(label=WORDS[status.state]),) if status is not None and known else ()
        return replace(row, state=UNKNOWN, needs_person=True, reason=(Code.ROUTER_GONE(), *last))

    def deaf(self, device: str) -> bool:
        """Return whether a missing router, estimator or bridge keeps all samples of a device from arriving."""
        info = self.stories[device].info
        estimators, bridges = self.alive["estimator"].copy(), self.alive["bridge"].copy()
        none = (self.looked or bool(estimators)) and not any(estimators.values())
        return not self.connected or none or (info is not None and bridges.get(info.bridge) is False)

    def broken(self, device: str, now: float) -> bool:
        """Return whether a fault of the ward stops the device's samples (`deaf`), or no estimator reports the device.

        now: monotonic time, s.
        """
        return self.deaf(device) or self.row(device, now).state == SILENT

    def troubles(self) -> Sentences:
        """Return the faults of the ward itself, as sentences; while no router is connected, only that fault."""
        if not self.connected:
            return (Code.WARD_ROUTER_GONE(),)
        seen, left_out = self.glance(), self.left_out.as_dict().get("devices")
        more = (
            (Code.DEVICES_LEFT_OUT(messages=left_out, bridges=", ".join(sorted(self.crowding)) or "–"),)
            if left_out
            else ()
        )
        return (*seen.troubles, *seen.law.values(), *more)

    def glance(self) -> WardSummary:
        """Return the ward's WardSummary: devices, which of them need a person, samples, and faults.

        It is cached until a status or info arrives, or a bridge or estimator comes or goes.
        """
        alive = {kind: [name for name, there in found.copy().items() if there] for kind, found in self.alive.items()}
        if self._glanced is not None and self._glanced[:2] == (self._news, alive):
            return self._glanced[2]  # twenty guides ask for it ten times a second
        statuses = {name: story.status for name, story in self.stories.items() if story.status}
        infos = {name: story.info for name, story in self.stories.items() if story.info}
        found = glance.summarise(self.ward, statuses, infos, alive["bridge"], alive["estimator"])
        self._glanced = self._news, alive, found
        return found
