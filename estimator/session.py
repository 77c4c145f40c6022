"""One device from its first sample on: readings in; corrected rates, calibrations and a status out.

A pure core: no clock, no bus, no store. Time is the device's own, in the batches; what was remembered of earlier boots
is handed in. What a block of device time teaches (`block`) is used from the end of the next one on: any batching of the
same samples gives the same corrected rates, and whoever runs it may learn meanwhile, when there is time.
"""

from collections.abc import Iterable
from functools import partial
from weakref import proxy

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import NO_REST_S, Calibration, DeviceInfo, SampleBatch, State, Status
from bridge.wire.refusal import Reason
from estimator.batch.capture import Floats
from estimator.batch.result import Result
from estimator.block import BLOCK_S, SHORT_S, TIME, Part, Stretch, joined, rows_of, temperature_at, where
from estimator.correction import Correction, Cut
from estimator.course import Course, Point
from estimator.finite import runs
from estimator.gyro import AXES
from estimator.learnt import Learnt
from estimator.lifecycle import Event, Life
from estimator.outcome import Outcome
from estimator.remembered import Remembered
from estimator.sequence import Sequence
from estimator.session_knobs import SessionKnobs
from estimator.stillness import too_seldom
from estimator.track.bias_filter import BiasState
from estimator.track.temperature import TemperatureLaw
from estimator.track.tracker import Tracker
from estimator.under_way import UnderWay
from estimator.windowed import Second

#: counted under this: turns that did not come along when another estimator took the device over
TURNS_LOST = "turns lost with an estimator"
#: after a silence this long the bias is less certain from the first sample on, not only once a second was judged
SILENCE_S = 5.0


class DeviceSession:
    """The life of one device across its boots; `began`, device s, if it is known when the first of them begins.

    sequence: the counts it goes on with.
    """

    def __init__(
        self, device: str, knobs: SessionKnobs | None = None, began: float = 0.0, sequence: Sequence | None = None
    ) -> None:
        self.device = device
        self.knobs = knobs or SessionKnobs()
        self.life = Life()
        self.sequence = sequence or Sequence()
        self.info: DeviceInfo | None = None
        self.last_heard_ns = 0
        #: whether somebody looks at windows of it: then what they are made of is kept
        self.windowed = False
        #: whether there is no time to learn of its bias
        self.coasts = False
        self._begin(began)
        self._unused = True  # since it was begun

    # ---- boots ----------------------------------------------------------------------------------------------------

    def begin_boot(
        self,
        boot: int,
        device_time: float,
        remembered: Remembered | None,
        law: TemperatureLaw | None = None,
        temperature_c: float | None = None,
    ) -> Outcome:
        """The device has started anew (or we have): forget this boot's calibration, then use what is remembered.

        law: what earlier boots taught of temperature. temperature_c: the device's now.
        """
        outcome = self.learn()  # what came of the one before
        first, again = self.boot is None, boot == self.boot and self.sequence.next is None
        self.sequence.begin(boot)
        if not self._unused or device_time != self.learnt.began or law is not None:
            self._begin(device_time, law)
        self._unused = False
        why = "warming up" if first else "the device was restarted: hold it still, then turn it about x, y and z"
        self.life.on(Event.BOOTED, "" if again else why)  # again: nothing was taken of it yet
        outcome.changed = True
        outcome.said.append(f"boot {boot:016x}" + ("" if first else ", recalibration needed"))
        calibration = None if remembered is None else remembered.calibration
        if remembered is not None and calibration is not None and calibration.boot == boot:
            self._restore(remembered, calibration, temperature_c)
            outcome.said.append(f"calibration {calibration.id} of this boot restored")
        elif calibration is not None:
            self.believe(calibration)
        if remembered is not None and self.learnt.resume(remembered, temperature_c):
            self._apply()
            outcome.said.append("bias of this boot restored")
        if remembered is not None and remembered.turned:
            self._lost_turns(remembered.turned, outcome)
        return outcome

    def _begin(self, device_time: float, law: TemperatureLaw | None = None) -> None:
        # What it has learnt would else keep a session that is no more, until Python looks for cycles.
        made = partial(_as_message, proxy(self))
        self.learnt = Learnt(self.knobs, device_time, law, self.life, self.sequence.events, made)
        self._course = Course(device_time)
        #: what is applied now, and from the end of this block on
        self._applied = self._ready = self.learnt.correction()
        #: the last whole block, while nothing is learnt from it yet, and what was applied to it
        self._lesson, self._lesson_applied = list[Part](), self._applied

    def _lost_turns(self, axes: tuple[int, ...], outcome: Outcome) -> None:
        if self.learnt.under_way is None:
            return
        names = ", ".join(AXES[axis] for axis in axes)
        lost = f"the turns about {names} were taken by an estimator that does not have it now: turn it about all three"
        self.learnt.scratch = lost
        self.sequence.events.add(TURNS_LOST, len(axes))
        outcome.said.append(lost)

    def start_over(self, why: str) -> Outcome:
        """It is not what it was: nothing known of it holds any more. Its samples go on."""
        course = self._course.anew()
        self._begin(course.latest)
        self._course = course
        self.learnt.scratch = why
        self.life.on(Event.CHANGED, "hold the device still for 3 seconds")
        return Outcome(changed=True, said=[why])

    def _restore(self, remembered: Remembered, calibration: Calibration, temperature_c: float | None) -> None:
        self.learnt.restore(remembered, calibration, temperature_c)
        if remembered.asked is not None:
            self.recalibrate(*remembered.asked)
        self._apply()

    def believe(self, calibration: Calibration) -> None:
        """Use the scale factors of an earlier boot until this one is calibrated."""
        if self.calibration is None:
            self.learnt.believe(calibration)
            self._apply()

    def moves(self, moves: float) -> None:
        """How far its scale moves from boot to boot (relative), by earlier ones."""
        if self.learnt.moves(moves):
            self._apply()

    def adopt(self, remembered: Remembered, calibration: Calibration) -> None:
        """What was known with a calibration of this very boot, by who had the device meanwhile; it ends one that is under way."""
        self._restore(remembered, calibration, self.tracker.thermometer.reading)
        self.learnt.scratch = ""

    # ---- samples --------------------------------------------------------------------------------------------------

    @property
    def boot(self) -> int | None:
        """The boot whose samples are taken."""
        return self.sequence.boot

    @property
    def calibration(self) -> Calibration | None:
        """Of this boot."""
        return self.learnt.calibration

    @property
    def prior(self) -> Calibration | None:
        """Of an earlier boot, under the same restore key."""
        return self.learnt.prior

    @property
    def tracker(self) -> Tracker:
        """Of this boot's bias."""
        return self.learnt.tracker

    @property
    def may_coast(self) -> bool:
        """Whether its bias may be only predicted for a while."""
        return not self.life.away and self.learnt.may_coast

    @property
    def applied(self) -> Correction:
        """What is applied to the samples that come next."""
        return self._applied

    def begins_earlier(self, batch: SampleBatch) -> bool:
        """Whether a batch is of the time before this boot was taken to begin, and nothing of it was taken yet."""
        return self.sequence.next is None and float(batch.device_time[0]) < self.learnt.began

    def plain(self, boot: int, sequence: int, first_s: float, last_s: float, samples: int) -> bool:
        """Whether a batch, all of it finite, from first_s to last_s of the device's clock, only goes on where the stream is."""
        return (
            boot == self.sequence.boot
            and sequence == self.sequence.next
            and self._course.goes_on(first_s, last_s, samples)
            and not self.life.away
        )

    @property
    def point(self) -> Point:
        """From where on samples go on."""
        return self._course.point

    def ends_block(self, last_s: float) -> bool:
        """Whether a sample at last_s of the device's clock is beyond the block that waits."""
        return self._course.ends_block(last_s)

    def keep(self, stretch: Stretch, rows: Floats, received_ns: int) -> None:
        """Take plain batches, without flags, that end no block, and their rows (n, 7), time by the device's clock.

        They are to be corrected by `applied`, which is all that `handle` would do. received_ns: when the last of them was.
        """
        self.sequence.went_on(len(rows))
        self.last_heard_ns = received_ns
        self._course.keep(rows, stretch)

    def end_block(self, stretch: Stretch, rows: Floats, received_ns: int) -> tuple[Outcome, list[Cut]]:
        """Take some that end a block, as `take` would; what of them is to be corrected by what, besides the outcome."""
        outcome = Outcome()
        self.sequence.went_on(len(rows))
        self.last_heard_ns = received_ns
        return outcome, self._take(stretch, rows, None, 0, 0.0, outcome)

    def handle(self, batch: SampleBatch) -> Outcome:
        """Take a batch and learn from it."""
        outcome = self.take(batch)
        self._learn(outcome)
        return outcome

    @property
    def to_learn(self) -> bool:
        """Whether there is a whole block that nothing was learnt from yet."""
        return bool(self._lesson)

    def learn(self) -> Outcome:
        """What the last whole block teaches; by itself at the end of the next one, from which on it is applied."""
        outcome = Outcome()
        self._learn(outcome)
        return outcome

    def take(self, batch: SampleBatch) -> Outcome:
        """Take a batch of the current boot (see Sequence.is_new_boot); samples late, repeated or not finite are counted."""
        outcome = Outcome()
        first = self.sequence.fresh(batch)
        if first == len(batch):
            return outcome
        away_s = max(0.0, (batch.receive_time_ns - self.last_heard_ns) / 1e9 / batch.clock_rate)
        self.last_heard_ns = batch.receive_time_ns
        if self.life.on(Event.HEARD):
            self._apply()
            outcome.changed = True
            outcome.said.append("heard again")
        finite = runs(batch, first)
        self.sequence.drop(Reason.NON_FINITE, len(batch) - first - sum(end - begin for begin, end in finite))
        flags = batch.flags if batch.flags.any() else None
        for begin, end in finite:
            marks = None if flags is None else flags[begin:end]
            cuts = self._take(batch, rows_of(batch, begin, end), marks, begin, away_s, outcome)
            outcome.corrected += [cut.correction.apply(batch, cut.first, cut.last) for cut in cuts]
        return outcome

    def _take(
        self,
        of: SampleBatch | Stretch,
        rows: Floats,
        flags: NDArray[np.uint32] | None,
        first: int,
        away_s: float,
        outcome: Outcome,
    ) -> list[Cut]:
        """Samples of a batch, or a stretch, from first on: rows (n, 7), time by the device's clock; flags (n,), if any."""
        course, last = self._course, first + len(rows)
        if course.went_back(rows.item(0, TIME), away_s):
            self.sequence.events.add("device clock went back")
        course.set_right(rows)
        latest = course.latest
        cuts, start, held = list[Cut](), 0, 0
        for edge in course.edges(rows):
            course.hold(rows[held:edge], None if flags is None else flags[held:edge], of, first + held)
            held, before = edge, self._applied
            now, heard = rows.item(edge, TIME), rows.item(edge - 1, TIME) if edge else latest
            if now - heard > SILENCE_S:
                self._end_block(outcome, (now, temperature_at(*where(of, first + edge))))
            else:
                self._end_block(outcome)
            if edge > start and self._applied is not before and not self._applied.same(before):
                cuts.append(Cut(before, first + start, first + edge))
                start = edge
        course.hold(rows[held:], None if flags is None else flags[held:], of, first + held)
        return [*cuts, Cut(self._applied, first + start, last)]

    def _end_block(self, outcome: Outcome, resumed: tuple[float, float | None] | None = None) -> None:
        """From here on all is applied that was learnt from the blocks before the one that ends, which is the next lesson.

        resumed: device time of the next sample, and how warm it is then, where a silence is before it.
        """
        self._learn(outcome)
        self._course.block_s = SHORT_S if self.learnt.awaited else BLOCK_S
        if resumed is not None:
            self.learnt.resumed(*resumed)
            self._ready = self.learnt.correction()
        self._lesson, self._lesson_applied = self._course.take(), self._applied
        self._applied = self._ready

    def _learn(self, outcome: Outcome) -> None:
        if not self._lesson:
            return
        parts, self._lesson = self._lesson, []
        if self.windowed:
            outcome.seconds.append(Second(joined(parts), self._lesson_applied))
        if self.learnt.learn(
            parts, self._course, outcome, coast=self.coasts
        ):  # where nothing is learnt batches stay whole
            self._ready = self.learnt.correction()

    def end(self) -> Outcome:
        """The stream is over: what its last blocks teach, without any more samples."""
        outcome = Outcome()
        self._end_block(outcome)
        self._learn(outcome)
        return outcome

    # ---- people and time ------------------------------------------------------------------------------------------

    def recalibrate(self, who: str, reason: str) -> str | None:
        """Ask for three new turns; the present calibration stays in use until they are taken. None, or why not."""
        if not self.life.on(Event.RECALIBRATE):
            so = (
                "it will be calibrated anyway"
                if self.life.state is State.WARMING
                else "nothing to do until it is heard"
            )
            return f"{self.device} is {self.life.state.name.lower()}: {so}"
        self.learnt.under_way = UnderWay(self.knobs, who, reason)
        why = f": {reason}" if reason else ""
        self.life.say(f"recalibration asked for by {who}{why}; hold it still for 3 seconds")
        return None

    def cancel(self, who: str) -> str | None:
        """Stop a calibration under way; the old one stays. None, or why not."""
        event = Event.CANCEL_TO_START if self.calibration is None else Event.CANCEL_TO_TRACKING
        if not self.life.on(event):
            return f"{self.device} is {self.life.state.name.lower()}: no calibration is under way"
        if self.tracker.doubt.stands:
            self.life.on(Event.DOUBTED)
        self.learnt.cancel(who)
        return None

    def silence(self, reason: str, event: Event = Event.SILENT) -> bool:
        """No samples come any more that can be used, as the event says, for this reason as it is now; True when that is news."""
        if not self.life.on(event, reason):
            unknown = (Event.OUTDATED, Event.SHED, Event.UNREACHABLE) if self.life.state is State.UNKNOWN else ()
            if event in unknown or (self.life.state, event) == (State.LOST, Event.SILENT):
                self.life.reason = reason
            return False
        self._apply()
        return True

    # ---- what is known --------------------------------------------------------------------------------------------

    def status(
        self,
        time_ns: int,
        *,
        bridge: str = "",
        refused_bridges: tuple[str, ...] = (),
        epoch: int = 0,
        silent_s: float = 0.0,
        more: Iterable[tuple[str, int]] = (),
    ) -> Status:
        """All of it, for the bus, with what is known of it outside the core: since when nothing came, events counted there."""
        known, learnt = self._ready, self.learnt
        seldom = self._too_seldom() if self.life.state is State.AWAITING_STILL else ""
        reason = seldom or self.life.reason
        if (doubted := self.tracker.doubt.why) and doubted not in reason and not self.life.away:
            reason = f"{reason}; {doubted}"  # whatever else is said of it
        events = self.sequence.events.as_dict() | self.tracker.events
        events.update(more)
        return Status(
            device=self.device,
            boot=self.boot or 0,
            time_ns=time_ns,
            state=self.life.state,
            quality=known.quality,
            reason=f"{reason} ({learnt.scratch})" if learnt.scratch else reason,
            progress=learnt.progress,
            axes_done=learnt.turned,
            bias=tuple(known.model.bias.tolist()),
            bias_std=tuple(known.bias_std.tolist()),
            scale=tuple(known.model.matrix.diagonal().tolist()),
            calibration=known.calibration,
            calibrated_time_ns=self.calibration.time_ns if self.calibration else 0,
            evidence_age_s=min(self.tracker.evidence_age(learnt.now) + silent_s, NO_REST_S),
            temperature_c=self.tracker.thermometer.reading,
            rate_hz=self._rate(),
            samples_in=self.sequence.samples_in,
            samples_out=self.sequence.samples_out,
            dropped=self.sequence.dropped.as_dict(),
            events=events,
            bridge=bridge,
            refused_bridges=refused_bridges,
            epoch=epoch,
        )

    def count_event(self, name: str) -> int:
        """Count something that happened to this device outside the core."""
        return self.sequence.events.add(name)

    def checkpoint(self) -> BiasState | None:
        """The bias as it would be restored; of a calibrated boot, or one that is sure of it, of which anything came."""
        return None if self.sequence.next is None else self.learnt.bias()

    def _apply(self) -> None:
        """Use all that is known at once: it does not come from samples."""
        self._applied = self._ready = self.learnt.correction()

    def _too_seldom(self) -> str:
        told = self.info
        rate_hz = max(told.rate_hz, told.measured_rate_hz) if told is not None else 0.0
        return too_seldom(rate_hz, self.knobs.stillness)

    def _rate(self) -> float:
        seconds = self._course.seconds
        return (self.sequence.seen - 1) / seconds if seconds > 0 else 0.0


def _as_message(session: DeviceSession, result: Result, who: str, now_ns: int) -> Calibration:
    info = session.info
    boot = session.boot or 0
    # The wire takes no infinity: what was not estimated is not named.
    known = bool(np.all(np.isfinite(result.covariance)))
    return Calibration(
        device=session.device,
        boot=boot,
        id=f"{session.device}-{boot:016x}-{now_ns // 1_000_000:x}",
        time_ns=now_ns,
        method=result.method,
        verdict=result.verdict,
        reason=result.reason,
        matrix=result.matrix,
        bias=result.bias,
        parameters=result.parameters if known else (),
        covariance=result.covariance if known else np.zeros((0, 0)),
        turns=result.turns,
        noise_std=result.noise_std if known else np.zeros(3),
        model=info.model if info else "",
        firmware=info.firmware if info else "",
        gyro_range=info.gyro_range if info else 0.0,
        rate_hz=info.rate_hz if info else 0.0,
        temperature_c=session.tracker.thermometer.reading,
        who=who,
    )
