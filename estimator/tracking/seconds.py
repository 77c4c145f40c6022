"""Blocks of one second: cuts a sample stream into blocks (`Second`), and marks blocks that are unfit for tracking.

A block with clipped or stuck readings, or with a gap of more than 0.25 s, does not measure rotation.
"""

from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.gyro_model import COARSE_STEP
from estimator.kernels import second_statistics as loop
from estimator.kernels.second_cuts import cut, let_go, nothing_gathered
from estimator.samples.sample_buffer import ACCEL, CELSIUS, GYRO, TIME
from estimator.state import Floats, StateStruct, shaped
from estimator.stillness.detector import Windows
from estimator.tracking.sample_gaps import HOLE, unseen

#: flaw of a second that shows movement
CLIPPED = "clipped"
#: rad/s, the coarsest resolution of a gyro; noise above it always shows in the readings
_COARSEST = radians(2.0)
#: s: length of a second; its least length where it ends early at a change between still and moving; and time for which the
#: device must have been, and stay, still
LENGTH_S, _LEAST_S, _SETTLE_S = 1.0, 0.5, 0.4
#: s; a longer silence hides what happened in it
GAP_S = 0.25


class Second(NamedTuple):
    """Block of about one second: n samples in sensor axes with their statistics.

    start, end: device time of the sample before the block, and of its last sample, s.
    dt (n,): sample intervals, s. gyro (n, 3): rad/s. accel (n, 3): m/s², or None.
    still: True if all of the block was judged still.
    flaw: reason why the block does not measure rotation (`clipped`, `gap` or `stuck`), or empty.
    mean, std (3,): mean and standard deviation of the gyro readings, rad/s.
    mean_var (3,): variance of the mean at rest, (rad/s)². common_var (3,): its part from rounding, equal in all means.
    noise_std (3,): standard deviation of one reading at rest, rad/s, as known at the end of the block.
    accel_mean, accel_std (3,): mean and standard deviation of the accelerometer readings, m/s², or None.
    accel_strength: mean magnitude of the accelerometer readings, m/s²; NaN without an accelerometer.
    celsius: mean temperature, °C; NaN when unknown.
    unseen_turn (rad), unseen_push (m/s): rms error of angle and velocity change from lost samples.
    last: number of the last sample, counted from the first one of the stream.
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
    celsius: float = float("nan")
    unseen_turn: float = 0.0
    unseen_push: float = 0.0
    last: int = -1

    @property
    def samples(self) -> int:
        """Number n of samples in the block."""
        return len(self.dt)


class SecondsState(StateStruct):
    """Saved state of `Seconds`, the cutter of a stream into one-second blocks.

    gathered (9,), waiting (k, 6): state of the unfinished block, and the windows that wait for a judgement. Their
        columns are those of `state` and `waiting` in kernels/second_cuts.py.
    before (9,): last sample before the present block, or None: device time (s), gyro (rad/s), accelerometer (m/s²),
        clipped, °C.
    step (3,): smallest difference between readings so far, rad/s.
    noisy: for each axis, True if the readings never repeat at rest.
    """

    gathered: Floats
    waiting: Floats
    before: Floats | None
    step: Floats
    noisy: tuple[bool, bool, bool]


class Seconds:
    """Cutter of a stream of stillness windows into one-second blocks.

    The boundaries of the blocks depend on the samples alone, not on how the samples are split into calls.
    """

    def __init__(self) -> None:
        self._state, self._waiting = nothing_gathered()
        self._parts: list[tuple[int, Floats]] = []  # samples of windows, with the number of each first one
        self._before: Floats | None = None  # the last sample before the second being gathered, (9,)
        self._step = np.full(3, np.inf)  # least difference ever seen
        self._noisy = np.zeros(3, bool)  # axes whose readings never repeat at rest
        self._all_noisy = False

    @property
    def state(self) -> SecondsState:
        """State to save for `restore`, without the samples themselves."""
        x, y, z = self._noisy.tolist()
        waiting = self._waiting[: int(self._state[1])]
        return SecondsState(self._state, waiting, self._before, self._step, (x, y, z))

    def restore(self, state: SecondsState, first: int, samples: Floats) -> None:
        """Restore a saved state, with the samples of the unfinished block and of the waiting windows.

        samples (n, 9): device time (s), gyro (rad/s), accelerometer (m/s²), clipped, temperature (°C).
        first: number of the first of these samples, counted from the first one of the stream.
        Raises ValueError when the state is damaged or needs other samples.
        """
        shaped(state.gathered, 9)
        shaped(state.waiting, int(state.gathered[1]), 6)
        shaped(state.step, 3)
        if state.before is not None:
            shaped(state.before, 9)
        numbers = [*state.waiting[:, 3:5].ravel().tolist(), *state.gathered[[4] if state.gathered[2] else []].tolist()]
        if not all(first <= number <= first + len(samples) for number in numbers):
            raise ValueError("damaged state: samples are missing; start without this state")
        self._state, self._step, self._before = state.gathered, state.step, state.before
        self._waiting[: len(state.waiting)] = state.waiting
        self._parts = [(first, samples)] if len(samples) else []
        self._noisy = np.array(state.noisy)
        self._all_noisy = all(state.noisy)

    @property
    def spikes(self) -> int:
        """Number of spikes corrected in all windows so far; a spike is a single reading far from both neighbours."""
        return int(self._state.item(-1))

    def take(self, windows: Windows) -> list[tuple[int, Second]]:
        """Add windows of the stillness detector, in the order of time; return the one-second blocks that they complete.

        Each result is a pair: index in `windows` of the window that completed the block, and the block.
        """
        if not len(windows):
            return []
        whole = cut(
            windows.found, windows.first, windows.begin, self._waiting, self._state, (LENGTH_S, _LEAST_S, _SETTLE_S)
        )
        self._parts.append(windows.samples)
        found = []
        for window, begin, end, still, aided in whole.tolist():
            samples, at = self._between(int(begin), int(end)), int(window)
            second = self._close(samples, windows.noise_std(at), int(end) - 1, still=still > 0, aided=aided > 0)
            found.append((at, second))
        return found

    def skip(self, windows: Windows) -> None:
        """Leave out one or more windows, and discard the unfinished block with all windows that wait for a judgement."""
        let_go(self._state, windows.moved)
        self._parts, self._before = [], windows.samples[1][-1]

    def _between(self, begin: int, end: int) -> Floats:
        """(n, 9) samples by number; earlier ones are discarded."""
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
            # Differences between neighbouring readings: slow sway must not count as noise.
            self._noisy |= rows[loop.JITTER] > np.sqrt(2) * self._step
            self._all_noisy = bool(self._noisy.all())
        flaw = CLIPPED if clips else "gap" if longest > GAP_S else ""
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
            rows.item(loop.CELSIUS, 0) if flaw != "gap" else samples.item(-1, CELSIUS),  # it may have cooled in the gap
            unseen_turn,
            unseen_push,
            last,
        )

    def _stuck(self, held: NDArray[np.bool_], noise_std: Floats) -> bool:
        """Return whether an axis repeats its readings that must not: held (3,) marks the axes that do."""
        # A gyro coarser than its noise may repeat readings at rest; an axis that showed noise before may not.
        return bool((held & (self._noisy | (noise_std > self._step / 2) & (noise_std > 1e-6))).any())
