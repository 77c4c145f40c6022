"""A calibration session as it happens: samples and windows in; what was recognised, and in the end a Result, out."""

from dataclasses import replace
from math import degrees, inf

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.recording.plausibility import ABSURD
from bridge.wire.messages import Verdict
from estimator.calibration.axis_alignment import foreign_axes
from estimator.calibration.capture import Capture, Floats, History, Movement, Rest, Samples, TurnCapture
from estimator.calibration.method_names import DEFAULT
from estimator.calibration.methods import BY_MOVEMENTS, METHODS
from estimator.calibration.movements import Movements
from estimator.calibration.result import PARAMETERS, Result, nothing, unlikely
from estimator.calibration.session_events import Finished, Ignored, Progress, RestFound, TurnFound
from estimator.calibration.stages import StageKnobs, Stages
from estimator.calibration.turn_recognition import NoTurn, TurnKnobs, recognise, rough_scale, same_bias
from estimator.geometry.gyro_model import AXES, axis_names
from estimator.stillness.detector import StillnessKnobs, Window, too_seldom

#: turns older than this, or taken at another bias, are not combined with new ones
STALE_S = 600.0
#: while a device is calibrated live by movements: fit after every so many of them, to so many of the latest
LIVE_EVERY, LIVE_MOVEMENTS = 2, 16
#: seconds of stillness that somebody probably meant for a rest
PAUSE_S = 0.8


class CalibrationSession:
    """Collects rests and turns in any order of axes until one turn about each is there.

    A method by movements runs after each of them too, and is done as soon as they determine a full matrix; with `whole`
    it runs only when asked for what it has, at the end of a recording. scale_limit: see `unlikely`.
    """

    def __init__(
        self,
        method: str = DEFAULT,
        k: Floats | None = None,
        stages: StageKnobs | None = None,
        turn_knobs: TurnKnobs | None = None,
        *,
        scale_limit: float = inf,
        whole: bool = False,
    ) -> None:
        self._run = METHODS[method]
        self.method = method
        self._k = np.ones(3) if k is None else k
        self._history = History()
        self._stages = Stages(self._history, stages)
        self._turn_knobs, self._scale_limit = turn_knobs or TurnKnobs(), scale_limit
        self._movements = Movements(self._turn_knobs)
        self._by_movements, self._whole = method in BY_MOVEMENTS, whole
        self.turns: dict[int, TurnCapture] = {}
        self._rests: list[Rest] = []
        #: whether there was a rest
        self.rested = self._moved_about = False
        self._too_small: set[int] = set()
        #: turns that were taken and no longer count, by axis, and why
        self._dropped: dict[int, Sentence] = {}
        self.last_reason: Sentences = ()

    @property
    def still_s(self) -> float:
        """How long the device has been still now."""
        return self._stages.still_s

    def add(self, samples: Samples) -> None:
        """Take samples; call `window` for every window they close, in order, after adding them."""
        self._history.add(samples)

    def take(self, rows: Floats) -> None:
        """The same of those of one or more windows, rows (n, 8)."""
        self._history.take(rows)

    def window(self, window: Window) -> list[Progress]:
        """Judge what the next window completes."""
        return self.judge(window.start_time, window.end_time, still=window.still)

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """The same by its times, s."""
        settled = self._stages.take(begun, ended, still=still)
        if settled is None:
            return []
        progress: list[Progress] = [RestFound(settled.after)]
        self.rested = True
        if settled.before is not None:
            self._moved_about = True
            self._keep(settled.before)
            movement = self._stages.movement(settled.before, settled.after)
            found = self._explained(recognise(movement, self._k, self._turn_knobs), settled.pause_s)
            kept = self._movements.add(movement, full_turn=not isinstance(found, NoTurn)) and self._by_movements
            if not isinstance(found, NoTurn):
                progress += self._turned(found)
            elif not kept:
                progress += self._ignored(found)
            if kept and not isinstance(progress[-1], Finished):
                progress += self._moved(settled.after)
        return progress

    def expire(self, now: float) -> tuple[int, ...]:
        """Forget the turns that are too old at a device time, s; their axes."""
        old = tuple(axis for axis in self.done() if now - self.turns[axis].samples.time[-1] >= STALE_S)
        for axis in old:
            self._drop(axis, too_old((axis,)))
        return old

    def done(self) -> tuple[int, ...]:
        """Axes with a turn that counts."""
        return tuple(sorted(self.turns))

    def missing(self) -> tuple[int, ...]:
        """Axes without a turn so far."""
        return tuple(axis for axis in range(3) if axis not in self.turns)

    @property
    def near(self) -> bool:
        """Whether the method may run after the next movement."""
        if self._by_movements:
            return len(self._movements) + 1 >= BY_MOVEMENTS[self.method]
        return len(self.turns) >= 2

    @property
    def movements(self) -> tuple[Movement, ...]:
        """What was kept of all that lay between rests, full turns or not."""
        return self._movements.all()

    def unfinished(self) -> Result:
        """The result when nothing more will come: which turns are missing, and the last reason why."""
        if self._by_movements:
            return self._checked(self._capture()) if self.movements else self._without_movements()
        missing = self.missing()
        dropped = [self._dropped[axis] for axis in missing if axis in self._dropped]
        unseen = axis_names(axis for axis in missing if axis not in self._dropped)
        because: Sentences
        if (largest := self._history.largest) > ABSURD:
            because = (Code.READINGS_IN_DEGREES(rate_rad_s=f"{largest:.0f}"),)
        elif not self.rested:
            seldom = too_seldom(self._history.rate_hz, StillnessKnobs())
            because = seldom or (Code.NEVER_STILL(duration_s=f"{self._stages.knobs.rest_s:g}"),)
        elif not self._moved_about:
            because = (Code.NEVER_MOVED(),)
        elif len(self._too_small) == 3:
            because = (Code.READINGS_IN_RADIANS(),)
        else:
            because = (Code.LAST_MOVEMENT(), *self.last_reason) if self.last_reason else ()
        said = (Code.NO_FULL_TURN(axes=unseen), *because) if unseen else ()
        return nothing(self.method, Verdict.REPEAT, (*dropped, *said), missing)

    def _explained(self, found: TurnCapture | NoTurn, pause_s: float) -> TurnCapture | NoTurn:
        if not isinstance(found, NoTurn):
            return found
        if found.unit_axis is not None:
            self._too_small.add(found.unit_axis)
        if not found.attempt or pause_s < PAUSE_S:
            return found
        return replace(found, reason=(*found.reason, Code.PAUSED(duration_s=f"{pause_s:.1f}")))

    def _keep(self, rest: Rest) -> None:
        """Keep a rest that has ended, and those since the first turn that still counts."""
        befores = (
            *(turn.before for turn in self.turns.values()),
            *(movement.before for movement in self.movements[:1]),
        )
        since = min((before.start for before in befores), default=rest.start)
        # Of a turn that waits for the others for hours no rest between counts any more.
        oldest = -inf if self._by_movements else rest.start - 2 * STALE_S
        self._rests = [r for r in self._rests if r.start >= since and r.end >= oldest] + [rest]

    def _ignored(self, no_turn: NoTurn) -> list[Progress]:
        self.last_reason = no_turn.reason
        return [Ignored(no_turn)]

    def _turned(self, turn: TurnCapture) -> list[Progress]:
        self.turns[turn.axis] = turn
        self._dropped.pop(turn.axis, None)
        newest = turn.samples.time[-1]
        dropped: dict[int, Sentence] = {}
        for axis, earlier in self.turns.items():
            if newest - earlier.samples.time[-1] >= STALE_S:
                dropped[axis] = too_old((axis,))
            elif not same_bias(earlier.before, turn.before, self._turn_knobs):
                by = degrees(float(np.max(np.abs(turn.before.bias - earlier.before.bias))))
                dropped[axis] = Code.TURN_BIAS_MOVED(axis=AXES[axis], rate_dps=f"{by:.1f}")
        for axis, why in dropped.items():
            self._drop(axis, why)
        progress: list[Progress] = [TurnFound(turn, dropped, self.missing())]
        if not self.missing() and not self._whole:
            result = self._checked(self._capture())
            self.turns = {axis: t for axis, t in self.turns.items() if axis not in result.repeat}
            progress.append(Finished(result, turn.after))
        return progress

    def _checked(self, capture: Capture) -> Result:
        """The method's result, unless what it was made from speaks against it."""
        if self._by_movements and not capture.movements:
            return self._without_movements()
        result = self._run(capture)
        if self._by_movements:
            return result  # these know of axes by themselves
        movements = [(movement.before, movement.samples) for movement in capture.movements]
        # A wrong gyro need not close: its scale is taken from the turns alone, whichever way round they were.
        fault = foreign_axes(movements, np.diag(rough_scale(capture.turns)))
        if fault is not None:
            return replace(result, verdict=Verdict.REFUSED, reason=(fault,), repeat=(0, 1, 2))
        odd = unlikely(result.scale, self._scale_limit)
        if result.verdict is Verdict.ACCEPTED and odd is not None:
            return replace(result, verdict=Verdict.REPEAT, repeat=odd[0], reason=odd[1])
        return result

    def _moved(self, rest: Rest) -> list[Progress]:
        if self._whole or len(self._movements) < BY_MOVEMENTS[self.method]:
            return []
        if len(self._movements) % LIVE_EVERY:
            return []  # a fit takes a while, and others are served by the same thread
        result = self._checked(self._capture(LIVE_MOVEMENTS))
        enough = result.verdict is Verdict.ACCEPTED and len(result.parameters) > len(PARAMETERS)
        return [Finished(result, rest)] if enough else []

    def _without_movements(self) -> Result:
        because = (Code.LAST_MOVEMENT(), *self.last_reason) if self.last_reason else ()
        reason: Sentences = (Code.NO_CHECKED_MOVEMENT(), *because)
        if size := self._stages.not_gravity:
            reason = (Code.ACCELEROMETER_NOT_GRAVITY(reading_m_s2=f"{size:.1f}"),)
        return nothing(self.method, Verdict.REFUSED, reason, (0, 1, 2))

    def _drop(self, axis: int, why: Sentence) -> None:
        del self.turns[axis]
        self._dropped[axis] = why

    def _capture(self, latest: int = 0) -> Capture:
        turns = tuple(self.turns[axis] for axis in sorted(self.turns))
        movements = self.movements[-latest:]
        befores = [turn.before for turn in turns] or [movement.before for movement in movements]
        first = min(befores, key=lambda rest: rest.start)
        afters = [turn.after for turn in turns] or [movement.after for movement in movements]
        last = max(afters, key=lambda rest: rest.start)
        rests = (*(rest for rest in self._rests if first.start <= rest.start < last.start), last)
        return Capture(first, turns, rests, movements)


def too_old(axes: tuple[int, ...]) -> Sentence:
    """Turns about these axes were made too long ago."""
    return Code.TURN_TOO_OLD(axes=axis_names(axes), most_minutes=f"{STALE_S / 60:.0f}")
