"""A calibration session as it happens: samples and windows in; what was recognised, and in the end a Result, out."""

from dataclasses import dataclass

import numpy as np

from bridge.wire.messages import Verdict
from estimator.batch.capture import Capture, Floats, History, Rest, Samples, TurnCapture
from estimator.batch.methods import DEFAULT, METHODS
from estimator.batch.recognise import NoTurn, TurnKnobs, recognise, same_bias
from estimator.batch.result import Result, nothing
from estimator.batch.stages import StageKnobs, Stages
from estimator.gyro import AXES
from estimator.stillness import Window

#: turns older than this, or taken at another bias, are not combined with new ones
STALE_S = 600.0


@dataclass(frozen=True, slots=True)
class RestFound:
    """A rest long enough to take a bias from; it may go on."""

    rest: Rest


@dataclass(frozen=True, slots=True)
class TurnFound:
    """A full turn about an axis."""

    turn: TurnCapture


@dataclass(frozen=True, slots=True)
class Ignored:
    """A movement that was not a full turn."""

    no_turn: NoTurn


@dataclass(frozen=True, slots=True)
class Finished:
    """Three turns are there and a method has run on them; `rest` is the one after the last turn."""

    result: Result
    rest: Rest


Progress = RestFound | TurnFound | Ignored | Finished


class CalibrationSession:
    """Collects rests and turns in any order of axes until one turn about each is there."""

    def __init__(
        self,
        method: str = DEFAULT,
        k: Floats | None = None,
        stages: StageKnobs | None = None,
        turn_knobs: TurnKnobs | None = None,
    ) -> None:
        self._run = METHODS[method]
        self.method = method
        self._k = np.ones(3) if k is None else k
        self._history = History()
        self._stages = Stages(self._history, stages)
        self._turn_knobs = turn_knobs or TurnKnobs()
        self.turns: dict[int, TurnCapture] = {}
        self._rests: list[Rest] = []
        self.last_reason = ""

    @property
    def still_s(self) -> float:
        """How long the device has been still now."""
        return self._stages.still_s

    def add(self, samples: Samples) -> None:
        """Take samples; call `window` for every window they close, in order, after adding them."""
        self._history.add(samples)

    def window(self, window: Window) -> list[Progress]:
        """Judge what the next window completes."""
        settled = self._stages.window(window)
        if settled is None:
            return []
        progress: list[Progress] = [RestFound(settled.after)]
        if settled.before is not None:
            self._keep(settled.before)
            movement = self._stages.movement(settled.before, settled.after)
            found = recognise(movement, self._k, self._turn_knobs)
            progress += self._ignored(found) if isinstance(found, NoTurn) else self._turned(found)
        return progress

    def missing(self) -> tuple[int, ...]:
        """Axes without a turn so far."""
        return tuple(axis for axis in range(3) if axis not in self.turns)

    def unfinished(self) -> Result:
        """The result when nothing more will come: which turns are missing, and the last reason why."""
        missing = self.missing()
        names = ", ".join(AXES[axis] for axis in missing)
        because = f" (last movement: {self.last_reason})" if self.last_reason else ""
        reason = f"no full turn about {names} was seen{because}"
        return nothing(self.method, Verdict.REPEAT, reason, missing)

    def _keep(self, rest: Rest) -> None:
        """Keep a rest that has ended, and those since the first turn that still counts."""
        since = min((turn.before.start for turn in self.turns.values()), default=rest.start)
        self._rests = [r for r in self._rests if r.start >= since] + [rest]

    def _ignored(self, no_turn: NoTurn) -> list[Progress]:
        self.last_reason = no_turn.reason
        return [Ignored(no_turn)]

    def _turned(self, turn: TurnCapture) -> list[Progress]:
        self.turns[turn.axis] = turn
        newest = turn.samples.time[-1]
        self.turns = {
            axis: t
            for axis, t in self.turns.items()
            if newest - t.samples.time[-1] < STALE_S and same_bias(t.before, turn.before, self._turn_knobs)
        }
        progress: list[Progress] = [TurnFound(turn)]
        if not self.missing():
            turns = tuple(self.turns[axis] for axis in range(3))
            first = min(turns, key=lambda t: float(t.samples.time[0]))
            rests = (*(rest for rest in self._rests if rest.start >= first.before.start), turn.after)
            result = self._run(Capture(first.before, turns, rests))
            self.turns = {axis: t for axis, t in self.turns.items() if axis not in result.repeat}
            progress.append(Finished(result, turn.after))
        return progress
