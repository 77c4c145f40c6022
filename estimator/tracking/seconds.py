"""A stream cut into seconds, each judged fit or not; what is no measurement never gets behind this door.

A second with clipped or stuck readings, or with a hole in it, tells nothing of rotation.
"""

from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.gyro_model import COARSE_STEP
from estimator.kernels import second_statistics as loop
from estimator.kernels.second_cuts import cut, let_go, nothing_gathered
from estimator.samples.sample_buffer import ACCEL, GYRO, TIME
from estimator.state import StateStruct, shaped
from estimator.stillness.detector import Windows
from estimator.tracking.sample_gaps import HOLE, unseen

Floats = NDArray[np.float64]
#: a flaw that shows movement
CLIPPED = "clipped"
#: rad/s, no gyro rounds its readings so coarsely that more noise than this does not show
_COARSEST = radians(2.0)


@dataclass(frozen=True, slots=True)
class SecondKnobs:
    """How a stream is cut. Seconds, rad/s."""

    length_s: float = 1.0
    #: a change between still and moving ends a second early, if it has lasted this long
    least_s: float = 0.5
    #: what is still is so only if it was so, and stays so, for this long
    settle_s: float = 0.4
    #: a silence this long hides what happened in it
    gap_s: float = 0.25


class Second(NamedTuple):
    """A second of n samples from `start` (the time of the one before) to `end`: dt (n,) s, gyro and accel (n, 3).

    still: all of it was judged so. flaw: why it tells nothing of rotation, or nothing.
    mean, std (3,) of the readings; mean_var (3,) of the mean, if it rests, and what of that rounding leaves in all means alike.
    noise_std (3,) of a reading, as it was known then.
    accel_mean, accel_std (3,) or None; accel_strength: the mean of its length, m/s², NaN without.
    last: the number of its last sample, from the first one fed.
    unseen_turn rad, unseen_push m/s: what lost samples leave unknown of the way turned and of the speed gained, rms.
    """

    start: float
    end: float
    dt: Floats
    gyro: Floats
    accel: Floats | None
    still: bool
    flaw: str
    mean: Floats
    std: Floats
    mean_var: Floats
    common_var: Floats
    noise_std: Floats
    accel_mean: Floats | None
    accel_std: Floats | None
    accel_strength: float = float("nan")
    unseen_turn: float = 0.0
    unseen_push: float = 0.0
    last: int = -1

    @property
    def samples(self) -> int:
        """How many samples it has."""
        return len(self.dt)


class SecondsState(StateStruct):
    """gathered (9,) and waiting (k, 6): see second_cuts.py. before (9,): the last sample ahead of the second that is gathered.

    step (3,): the least difference of readings ever seen. noisy: axes that never repeat themselves at rest.
    """

    gathered: Floats
    waiting: Floats
    before: Floats | None
    step: Floats
    noisy: tuple[bool, bool, bool]


class Seconds:
    """Windows in, seconds out; the cut depends on the samples alone."""

    def __init__(self, knobs: SecondKnobs | None = None) -> None:
        self.knobs = knobs or SecondKnobs()
        self._numbers = (self.knobs.length_s, self.knobs.least_s, self.knobs.settle_s)
        self._state, self._waiting = nothing_gathered()
        self._parts: list[tuple[int, Floats]] = []  # samples of windows, and the number of the first of them
        self._before: Floats | None = None  # the last sample before the second that is gathered, (9,)
        self._step = np.full(3, np.inf)  # the least ever seen
        self._noisy = np.zeros(3, bool)  # axes that never repeat themselves at rest
        self._all_noisy = False

    @property
    def state(self) -> SecondsState:
        """All that evolves, beside the samples of what is gathered and of what waits."""
        x, y, z = self._noisy.tolist()
        waiting = self._waiting[: int(self._state[1])]
        return SecondsState(self._state, waiting, self._before, self._step, (x, y, z))

    def restore(self, state: SecondsState, first: int, samples: Floats) -> None:
        """Go on from a state, with the samples (n, 9) of the windows so far, numbered from `first` on.

        Raises ValueError, also where the state tells of other samples.
        """
        shaped(state.gathered, 9)
        shaped(state.waiting, int(state.gathered[1]), 6)
        shaped(state.step, 3)
        if state.before is not None:
            shaped(state.before, 9)
        numbers = [*state.waiting[:, 3:5].ravel().tolist(), *state.gathered[[4] if state.gathered[2] else []].tolist()]
        if not all(first <= number <= first + len(samples) for number in numbers):
            raise ValueError("damaged state: samples are missing")
        self._state, self._step, self._before = state.gathered, state.step, state.before
        self._waiting[: len(state.waiting)] = state.waiting
        self._parts = [(first, samples)] if len(samples) else []
        self._noisy = np.array(state.noisy)
        self._all_noisy = all(state.noisy)

    @property
    def spikes(self) -> int:
        """How many there were."""
        return int(self._state.item(-1))

    def take(self, windows: Windows) -> list[tuple[int, Second]]:
        """The seconds that are known whole with the next windows, and with which of them."""
        if not len(windows):
            return []
        whole = cut(windows.found, windows.first, windows.begin, self._waiting, self._state, self._numbers)
        self._parts.append(windows.samples)
        found = []
        for window, begin, end, still, aided in whole.tolist():
            samples, at = self._between(int(begin), int(end)), int(window)
            second = self._close(samples, windows.noise_std(at), int(end) - 1, still=still > 0, aided=aided > 0)
            found.append((at, second))
        return found

    def skip(self, windows: Windows) -> None:
        """Let the next windows go by, and those that wait."""
        let_go(self._state, windows.moved)
        self._parts, self._before = [], windows.samples[1][-1]

    def _between(self, begin: int, end: int) -> Floats:
        """(n, 9) samples by their numbers; those before are forgotten."""
        parts = self._parts
        first, rows = parts[0]
        while first + len(rows) <= begin:
            del parts[0]
            first, rows = parts[0]
        if end <= first + len(rows):
            return rows[begin - first : end - first]
        return np.concatenate([rows[max(0, begin - first) : end - first] for first, rows in parts if first < end])

    def _close(self, samples: Floats, noise_std: Floats, last: int, *, still: bool, aided: bool) -> Second:
        before, self._before = self._before, samples[-1]
        gyro, accel = samples[:, GYRO], samples[:, ACCEL] if aided else None
        usual = 0.0 if before is not None else float(np.median(np.diff(samples[:, TIME])))
        first = samples.item(0, TIME) - usual if before is None else before.item(TIME)
        dt, rows, clips = loop.measured(samples, first, _COARSEST, COARSE_STEP, self._step)
        least_std, longest, strength = rows[loop.SCALARS].tolist()
        if still and not self._all_noisy:
            # From one reading to the next: a slow sway is no noise.
            self._noisy |= rows[loop.JITTER] > np.sqrt(2) * self._step
            self._all_noisy = bool(self._noisy.all())
        flaw = CLIPPED if clips else "gap" if longest > self.knobs.gap_s else ""
        if not flaw and not least_std > 1e-9 and self._stuck(rows[loop.HELD] == 1, noise_std):
            flaw = "stuck"
        end, unseen_turn, unseen_push = samples.item(-1, TIME), 0.0, 0.0
        if not flaw and longest * len(dt) > HOLE * (end - first):
            unseen_turn = unseen(dt, gyro, gyro[0] if before is None else before[GYRO])
            if accel is not None:
                pushed = accel[0] if before is None or np.isnan(before[ACCEL]).any() else before[ACCEL]
                unseen_push = unseen(dt, accel, pushed)
        return Second(
            first,
            end,
            dt,
            gyro,
            accel,
            still,
            flaw,
            rows[loop.MEAN],
            rows[loop.STD],
            rows[loop.MEAN_VAR],
            rows[loop.COMMON_VAR],
            noise_std,
            None if accel is None else rows[loop.ACCEL_MEAN],
            None if accel is None else rows[loop.ACCEL_STD],
            strength,
            unseen_turn,
            unseen_push,
            last,
        )

    def _stuck(self, held: NDArray[np.bool_], noise_std: Floats) -> bool:
        """Whether one of the axes that repeat themselves, held (3,), may not."""
        # A gyro coarser than its noise may well do so at rest; one that showed noise before may not.
        return bool((held & (self._noisy | (noise_std > self._step / 2) & (noise_std > 1e-6))).any())
