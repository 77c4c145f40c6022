"""A stream cut into seconds, each judged fit or not; what is no measurement never gets behind this door.

A second with clipped or stuck readings, or with a hole in it, tells nothing of rotation.
"""

from collections import deque
from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.refusal import Tally
from estimator.block import ACCEL, GYRO, TIME
from estimator.gyro import COARSE_STEP
from estimator.loops import second as loop
from estimator.stillness import Window
from estimator.track.unseen import HOLE, unseen

Floats = NDArray[np.float64]
#: a window, and whether it is still for all that is known of those around it
Judged = tuple[Window, bool]
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
    accel_mean, accel_std (3,) or None; accel_strength: the mean of its length, m/s², NaN without.
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
    accel_mean: Floats | None
    accel_std: Floats | None
    accel_strength: float = float("nan")
    unseen_turn: float = 0.0
    unseen_push: float = 0.0

    @property
    def samples(self) -> int:
        """How many samples it has."""
        return len(self.dt)


class Seconds:
    """Windows in, seconds out; the cut depends on the samples alone."""

    def __init__(self, knobs: SecondKnobs | None = None) -> None:
        self.knobs = knobs or SecondKnobs()
        self.refused = Tally()
        self._windows: list[Judged] = []
        self._coming: deque[Judged] = deque()
        self._moved = -np.inf  # when the last window ended that was not still
        self._last: Window | None = None  # before the second that is gathered
        self._step = np.full(3, np.inf)  # the least ever seen
        self._noisy = np.zeros(3, bool)  # axes that never repeat themselves at rest
        self._all_noisy = False

    def window(self, window: Window, noise_std: Floats) -> list[Second]:
        """The seconds that are known whole after the next window; noise_std (3,) rad/s of a reading."""
        if window.spikes:
            self.refused.add("spike", window.spikes)
        # A movement begins and ends too gently for those windows to tell: what seems still waits to see how it goes on.
        now, settle_s, coming = window.end_time, self.knobs.settle_s, self._coming
        whole: list[Second] = []
        if window.still:
            coming.append((window, window.start_time - self._moved >= settle_s))
        else:  # movement is judged for good at once, and what waited is next to it
            self._moved = now
            while coming:
                self._take(coming.popleft()[0], noise_std, whole, still=False)
            self._take(window, noise_std, whole, still=False)
            return whole
        while coming and not (coming[0][1] and now - coming[0][0].end_time < settle_s):
            judged, still = coming.popleft()
            self._take(judged, noise_std, whole, still=still)
        return whole

    def skip(self, window: Window) -> None:
        """Let the next window go by, and those that wait."""
        self._windows, self._last = [], window
        self._coming.clear()

    def _take(self, window: Window, noise_std: Floats, whole: list[Second], *, still: bool) -> None:
        windows = self._windows
        if windows and windows[-1][1] != still and window.start_time - windows[0][0].start_time >= self.knobs.least_s:
            whole.append(self._close(noise_std))
            windows = self._windows
        windows.append((window, still))
        if window.end_time - windows[0][0].start_time >= self.knobs.length_s:
            whole.append(self._close(noise_std))

    def _close(self, noise_std: Floats) -> Second:
        windows = self._windows
        parts, still, aided = list[Floats](), True, True
        for window, so_still in windows:
            parts.append(window.rows)
            still &= so_still
            aided &= window.aided
        before, self._last, self._windows = self._last, windows[-1][0], []
        samples = np.concatenate(parts)
        gyro, accel = samples[:, GYRO], samples[:, ACCEL] if aided else None
        first = float(samples[0, TIME] - np.median(np.diff(samples[:, TIME]))) if before is None else before.end_time
        dt, rows, clips = loop.measured(samples, first, _COARSEST, COARSE_STEP, self._step)
        least_std, longest, strength = rows[loop.SCALARS].tolist()
        if still and not self._all_noisy:
            # From one reading to the next: a slow sway is no noise.
            self._noisy |= rows[loop.JITTER] > np.sqrt(2) * self._step
            self._all_noisy = bool(self._noisy.all())
        flaw = "clipped" if clips else "gap" if longest > self.knobs.gap_s else ""
        if not flaw and not least_std > 1e-9 and self._stuck(rows[loop.HELD] == 1, noise_std):
            flaw = "stuck"
        end, unseen_turn, unseen_push = self._last.end_time, 0.0, 0.0
        if not flaw and longest * len(dt) > HOLE * (end - first):
            unseen_turn = unseen(dt, gyro, gyro[0] if before is None else before.gyro[-1])
            if accel is not None:
                pushed = accel[0] if before is None or before.accel is None else before.accel[-1]
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
            None if accel is None else rows[loop.ACCEL_MEAN],
            None if accel is None else rows[loop.ACCEL_STD],
            strength,
            unseen_turn,
            unseen_push,
        )

    def _stuck(self, held: NDArray[np.bool_], noise_std: Floats) -> bool:
        """Whether one of the axes that repeat themselves, held (3,), may not."""
        # A gyro coarser than its noise may well do so at rest; one that showed noise before may not.
        return bool((held & (self._noisy | (noise_std > self._step / 2) & (noise_std > 1e-6))).any())
