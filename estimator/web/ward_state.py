"""All that was heard of a ward and its devices: the one place that every page reads. Pure: time is an argument."""

from collections import deque
from dataclasses import dataclass, field, replace

from bridge.reasons.codes import Code, Sentences
from bridge.wire import keys
from bridge.wire.messages import BiasRevision, BootCause, Calibration, DeviceInfo, Note, State, Status, Verdict
from bridge.wire.refusal import Tally
from estimator.device.lifecycle import AWAY
from estimator.overview import summary as glance
from estimator.overview.summary import WardSummary
from estimator.overview.ward import SILENT, SILENT_S, UNKNOWN, WORDS, DeviceRow, WardView
from estimator.service.history import Biases, History
from estimator.web.device_trail import Mark, Trail

#: who is alive shows it within so long of there being a router, s
LOOKED_S = 2.0
#: devices that are remembered: as many as an estimator has, and some that only a bridge speaks of, at most so many
DEVICES, STRANGERS = 4200, 256
#: a device without a calibration is forgotten after so many seconds without a status, while others have theirs
FORGET_S = 120.0
#: bridges that are named where they list too many devices
_NAMED = 8
CALIBRATIONS, NOTES, BOOTS = 50, 50, 50
_CAUSES = {
    BootCause.UNKNOWN: "",
    BootCause.POWER_UP: "switched on",
    BootCause.PORT_OPENED: "port opened",
}


@dataclass(frozen=True, slots=True)
class Boot:
    """A boot that was seen or that the store has; time_ns of the first that was heard of it, cause a label."""

    boot: int
    time_ns: int
    cause: str
    what: str


@dataclass(slots=True)
class Story:
    """One device. Calibrations and boots by id, oldest first."""

    number: int
    status: Status | None = None
    info: DeviceInfo | None = None
    trail: Trail = field(default_factory=Trail)
    #: when it was said last that samples come from it, by the clock messages are heard by; None when it never was
    heard_s: float | None = None
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    notes: deque[Note] = field(default_factory=lambda: deque(maxlen=NOTES))
    boots: dict[int, Boot] = field(default_factory=dict)
    #: of its present boot, from a store
    biases: Biases | None = None

    @property
    def boot(self) -> int:
        """The present one; 0 when it has not been heard."""
        return self.status.boot if self.status else self.info.boot if self.info else 0

    def take_calibration(self, calibration: Calibration) -> None:
        """One that was made, accepted or not; one that is known already changes nothing, nor does one that is too old."""
        if calibration.id in self.calibrations:
            return
        found = sorted((*self.calibrations.values(), calibration), key=lambda one: one.time_ns)
        in_use = [one for one in found[:-CALIBRATIONS] if self.status is not None and one.id == self.status.calibration]
        self.calibrations = {one.id: one for one in (*in_use, *found[-CALIBRATIONS:])}
        if calibration.id not in self.calibrations:
            return
        accepted = calibration.verdict is Verdict.ACCEPTED
        self.trail.mark(Mark(calibration.time_ns, "calibrated" if accepted else "refused", calibration.reason))

    def take_note(self, note: Note) -> None:
        """What somebody wrote of it; the same again changes nothing."""
        if note not in self.notes:
            self.notes.append(note)
            self.trail.mark(Mark(note.time_ns, "note", f"{note.who}: {note.text}"))

    def hears(self, bridge: str) -> bool:
        """Whether it is this bridge whose word counts: the one that the estimator takes its samples from, where it takes any."""
        return self.status is None or not self.status.boot or self.status.bridge in {"", bridge}

    def take_boot(self, boot: Boot) -> None:
        """A boot; of one that is known already the earlier time is kept."""
        known = self.boots.get(boot.boot)
        if known is None or boot.time_ns < known.time_ns:
            self.boots[boot.boot] = boot
            self.boots = dict(sorted(self.boots.items(), key=lambda item: item[1].time_ns)[-BOOTS:])


class Known:
    """A ward."""

    def __init__(self, ward: str) -> None:
        self.ward = ward
        self.connected = False
        #: whether there is a router for so long that an estimator which does not show itself is none
        self.looked = False
        self._alone_at: float | None = None
        self.left_out = Tally()
        self.stories: dict[str, Story] = {}
        #: bridges that list more devices than there is room for
        self.crowding: set[str] = set()
        #: ids of what is alive now, by `bridge` and `estimator`; written by a thread of the bus
        self.alive: dict[str, dict[str, bool]] = {"bridge": {}, "estimator": {}}
        self._view = WardView()
        #: statuses and infos so far, and what the ward looked like by them
        self._news = 0
        self._glanced: tuple[int, dict[str, list[str]], WardSummary] | None = None

    def story(self, device: str, *, status: bool = False) -> Story | None:
        """Of a device; None where there are too many. A device that has a status takes the place of one that has none."""
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
        """Forget devices without a calibration of which the estimator speaks no more, while it speaks of others."""
        spoken = self._view.silences(now)
        if not spoken or min(spoken.values()) > SILENT_S:
            return
        for device, silent_s in spoken.items():
            status = self.stories[device].status
            if silent_s > FORGET_S and status is not None and not status.calibration:
                self._forget(device)

    def _forget(self, device: str) -> None:
        del self.stories[device]
        for number, story in enumerate(self.stories.values()):
            story.number = number
        self._view.forget(device)
        self._news += 1

    def take_router(self, now: float, *, there: bool) -> None:
        """Whether there is a router, at `now` seconds."""
        self.connected = there
        if self._alone_at is None or not there:
            self._alone_at = now
        self.looked = now - self._alone_at > LOOKED_S

    def take_status(self, status: Status, now: float) -> None:
        """The estimator's word on a device, heard at `now` seconds."""
        if (story := self.story(status.device, status=True)) is not None:
            again, story.status = story.status is not None, status
            if again and status.state not in AWAY:  # the first word may be one that the bus remembers
                story.heard_s = now
            story.trail.take(status)
            self._view.take_status(status, now)
            self._news += 1

    def take_info(self, info: DeviceInfo) -> None:
        """A bridge's word on a device; of several bridges that list it, the one that hears it has the last."""
        if not self._view.room(info.device, STRANGERS):
            self.left_out.add("devices")
            if len(self.crowding) < _NAMED:
                self.crowding.add(info.bridge)
            return
        if (story := self.story(info.device)) is None:
            return
        hears = story.hears(info.bridge)
        if hears and (info.boot or story.info is None or story.info.bridge == info.bridge):
            story.info = info
        if hears and info.boot and info.boot not in story.boots:
            what = f"{info.model} {info.firmware}".strip()
            story.take_boot(Boot(info.boot, info.time_ns, _CAUSES[info.boot_cause], what))
        self._view.take_info(info)
        self._news += 1

    def take_calibration(self, calibration: Calibration) -> None:
        """A calibration as it was published."""
        if (story := self.story(calibration.device)) is not None:
            story.take_calibration(calibration)

    def take_note(self, note: Note) -> None:
        """A note as it was published."""
        if (story := self.story(note.device)) is not None:
            story.take_note(note)

    def take_revision(self, revision: BiasRevision) -> None:
        """What the bias of the past was."""
        if (story := self.story(revision.device)) is not None:
            story.trail.revise(revision)

    def take_past(self, past: History) -> None:
        """What a store has of a device."""
        if (story := self.stories.get(past.device)) is None:
            return
        for calibration in reversed(past.calibrations):  # those that are too old come last, and leave no marks
            story.take_calibration(calibration)
        for row in past.boots:
            cause = _CAUSES.get(BootCause[row["cause"]], "") if row["cause"] in BootCause.__members__ else ""
            story.take_boot(
                Boot(int(row["boot"], 16), row["time_ns"], cause, f"{row['model']} {row['firmware']}".strip())
            )
        story.biases = next((one for one in past.biases if one.boot == keys.boot_id(story.boot)), None)

    def rows(self, now: float) -> list[DeviceRow]:
        """Every device, those that need a person first."""
        rows = self._view.rows(now)
        return rows if self.connected else sorted(map(self._unheard, rows), key=lambda row: row.order)

    def row(self, device: str, now: float) -> DeviceRow:
        """One that was heard of; while there is no router it is not known how it is."""
        row = self._view.row(device, now)
        return row if self.connected else self._unheard(row)

    def _unheard(self, row: DeviceRow) -> DeviceRow:
        """The same while nothing can be heard: unknown, and never gone."""
        status = self.stories[row.device].status
        known = status is not None and status.state is not State.UNKNOWN
        last = (Code.LAST_STATE(label=WORDS[status.state]),) if status is not None and known else ()
        return replace(row, state=UNKNOWN, reason=(Code.ROUTER_GONE(), *last))

    def deaf(self, device: str) -> bool:
        """Whether nothing of a device can be heard by fault of the ward: router, estimator, or its bridge are gone."""
        info = self.stories[device].info
        estimators, bridges = self.alive["estimator"].copy(), self.alive["bridge"].copy()
        none = (self.looked or bool(estimators)) and not any(estimators.values())
        return not self.connected or none or (info is not None and bridges.get(info.bridge) is False)

    def broken(self, device: str, now: float) -> bool:
        """The same, or nobody has a word for it any more."""
        return self.deaf(device) or self.row(device, now).state == SILENT

    def troubles(self) -> Sentences:
        """What is wrong with the ward itself; while there is no router nothing else can be known."""
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
        """The ward at one look."""
        alive = {kind: [name for name, there in found.copy().items() if there] for kind, found in self.alive.items()}
        if self._glanced is not None and self._glanced[:2] == (self._news, alive):
            return self._glanced[2]  # twenty guides ask for it ten times a second
        statuses = {name: story.status for name, story in self.stories.items() if story.status}
        infos = {name: story.info for name, story in self.stories.items() if story.info}
        found = glance.summarise(self.ward, statuses, infos, alive["bridge"], alive["estimator"])
        self._glanced = self._news, alive, found
        return found
