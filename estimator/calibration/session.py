"""Live calibration session: takes samples and windows, reports recognised rests and turns, and ends with a Result."""

from dataclasses import replace
from math import degrees, inf

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.recording.plausibility import ABSURD
from bridge.wire.messages import Verdict
from estimator.calibration.axis_alignment import foreign_axes
from estimator.calibration.capture import Capture, Floats, History, Movement, Rest, TurnCapture
from estimator.calibration.method_names import DEFAULT
from estimator.calibration.methods import BY_MOVEMENTS, METHODS
from estimator.calibration.movements import Movements
from estimator.calibration.result import PARAMETERS, Result, nothing, unlikely
from estimator.calibration.session_events import Finished, Ignored, Progress, RestFound, TurnFound
from estimator.calibration.stages import REST_S, Stages
from estimator.calibration.turn_recognition import NoTurn, recognise, rough_scale, same_bias
from estimator.geometry.gyro_model import AXES, axis_names
from estimator.stillness.detector import too_seldom

#: turns older than this, or made at a different bias, are not combined with new ones
STALE_S = 600.0
#: live calibration by movements: fit after every LIVE_EVERY movements, to the latest LIVE_MOVEMENTS
LIVE_EVERY, LIVE_MOVEMENTS = 2, 16
#: stillness, s, that was probably meant to be a rest
PAUSE_S = 0.8


class CalibrationSession:
    """Live calibration by hand: collects rests and turns, in any order of axes, until each axis has a full turn.

    Methods `transitions` and `accel_aided` also use movements that are no full turns. A session with one of these ends
    as soon as the movements determine a full matrix.
    method: a key of METHODS.
    gyro_range: full-scale range, rad/s; infinite when unknown.
    horizontal: True to accept only turns about a horizontal axis; without an accelerometer it has no effect.
    scale_limit: largest plausible relative difference of a scale factor from 1, see `unlikely`.
    whole: True to compute no result during the recording, but only by `unfinished` at its end.
    """

    def __init__(
        self,
        method: str = DEFAULT,
        *,
        gyro_range: float = inf,
        horizontal: bool = False,
        scale_limit: float = inf,
        whole: bool = False,
    ) -> None:
        self._run = METHODS[method]
        self.method = method
        self._history = History()
        self._stages = Stages(self._history)
        self._gyro_range, self._horizontal, self._scale_limit = gyro_range, horizontal, scale_limit
        self._movements = Movements(gyro_range)
        self._by_movements, self._whole = method in BY_MOVEMENTS, whole
        self.turns: dict[int, TurnCapture] = {}
        self._rests: list[Rest] = []
        #: whether a rest was found
        self.rested = self._moved_about = False
        self._too_small: set[int] = set()
        #: by axis, why a turn taken earlier no longer counts
        self._dropped: dict[int, Sentence] = {}
        self.last_reason: Sentences = ()

    @property
    def still_s(self) -> float:
        """Seconds for which the device has been still; 0 while it moves."""
        return self._stages.still_s

    def take(self, rows: Floats) -> None:
        """Store the samples of one or more windows of the stillness detector: rows (n, 9).

        Call `judge` for each window afterwards.

        Columns: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped (0 or 1), temperature (°C).
        """
        self._history.take(rows)

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Process one window of the stillness detector and return the events that it completes, possibly none.

        Windows must come in the order of time, after `take` has stored their samples.
        begun, ended: start and end of the window, device time in s.
        still: True if the stillness detector judged the window still.
        """
        settled = self._stages.take(begun, ended, still=still)
        if settled is None:
            return []
        progress: list[Progress] = [RestFound(settled.after)]
        self.rested = True
        if settled.before is not None:
            self._moved_about = True
            self._keep(settled.before)
            movement = self._stages.movement(settled.before, settled.after)
            turn = recognise(movement, self._gyro_range, horizontal=self._horizontal)
            found = self._explained(turn, settled.pause_s)
            kept = self._movements.add(movement, full_turn=not isinstance(found, NoTurn)) and self._by_movements
            if not isinstance(found, NoTurn):
                progress += self._turned(found)
            elif not kept:
                self.last_reason = found.reason
                progress.append(Ignored(found))
            if kept and not isinstance(progress[-1], Finished):
                progress += self._moved(settled.after)
        return progress

    def expire(self, now: float) -> tuple[int, ...]:
        """Drop the turns that ended 600 s or more before device time `now`, s, and return their axes (0 to 2)."""
        if not self.turns:
            return ()
        old = tuple(axis for axis in self.done() if now - self.turns[axis].samples.time[-1] >= STALE_S)
        for axis in old:
            self._drop(axis, too_old((axis,)))
        return old

    def done(self) -> tuple[int, ...]:
        """Axes (0 to 2, in order) with a valid turn."""
        return tuple(sorted(self.turns))

    def missing(self) -> tuple[int, ...]:
        """Axes (0 to 2, in order) without a valid turn."""
        return tuple(axis for axis in range(3) if axis not in self.turns)

    @property
    def movements(self) -> tuple[Movement, ...]:
        """Movements kept between rests, full turns or not, in the order of time."""
        return tuple(self._movements.kept)

    def unfinished(self) -> Result:
        """Build the result at the end of the input, where the session has not reported a result.

        Methods `transitions` and `accel_aided` are fitted to the movements so far. Any other method gives verdict
        REPEAT, with the missing turns and the latest reason.
        """
        if self._by_movements:
            return self._checked(self._capture()) if self.movements else self._without_movements()
        missing = self.missing()
        dropped = [self._dropped[axis] for axis in missing if axis in self._dropped]
        unseen = axis_names(axis for axis in missing if axis not in self._dropped)
        because: Sentences
        if (largest := self._history.largest) > ABSURD:
            because = (Code.READINGS_IN_DEGREES(rate_rad_s=f"{largest:.0f}"),)
        elif not self.rested:
            seldom = too_seldom(self._history.rate_hz)
            because = seldom or (Code.NEVER_STILL(duration_s=f"{REST_S:g}"),)
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
        """Keep a rest that has ended, and the rests since the first turn that still counts."""
        befores = (
            *(turn.before for turn in self.turns.values()),
            *(movement.before for movement in self.movements[:1]),
        )
        since = min((before.start for before in befores), default=rest.start)
        # While a turn waits for hours for the others, the rests in between no longer count.
        oldest = -inf if self._by_movements else rest.start - 2 * STALE_S
        self._rests = [r for r in self._rests if r.start >= since and r.end >= oldest] + [rest]

    def _turned(self, turn: TurnCapture) -> list[Progress]:
        self.turns[turn.axis] = turn
        self._dropped.pop(turn.axis, None)
        newest = turn.samples.time[-1]
        dropped: dict[int, Sentence] = {}
        for axis, earlier in self.turns.items():
            if newest - earlier.samples.time[-1] >= STALE_S:
                dropped[axis] = too_old((axis,))
            elif not same_bias(earlier.before, turn.before):
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
        """The method's result, unless its turns or scale factors are implausible."""
        if self._by_movements and not capture.movements:
            return self._without_movements()
        result = self._run(capture)
        if self._by_movements:
            return result  # methods by movements check the axes themselves
        movements = [(movement.before, movement.samples) for movement in capture.movements]
        # A gyro with wrong axes need not close. Its scale comes from the turns alone, in either direction.
        fault = foreign_axes(movements, np.diag(rough_scale(capture.turns)))
        if fault is not None:
            return replace(result, verdict=Verdict.REFUSED, reason=(fault,), repeat=(0, 1, 2))
        odd = unlikely(result.scale, self._scale_limit)
        if result.verdict is Verdict.ACCEPTED and odd is not None:
            return replace(result, verdict=Verdict.REPEAT, repeat=odd[0], reason=odd[1])
        return result

    def _moved(self, rest: Rest) -> list[Progress]:
        if self._whole or len(self.movements) < BY_MOVEMENTS[self.method]:
            return []
        if len(self.movements) % LIVE_EVERY:
            return []  # a fit is slow, and the same thread serves other devices
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
    """Reason text that turns are too old to be combined with new ones.

    axes: axes (0 to 2) of these turns.
    """
    return Code.TURN_TOO_OLD(axes=axis_names(axes), most_minutes=f"{STALE_S / 60:.0f}")
