"""A stream cut into seconds, each judged fit or not; what is no measurement never gets behind this door.

A second with clipped or stuck readings, or with a hole in it, tells nothing of rotation.
"""

from dataclasses import dataclass
from math import isfinite, radians

import numpy as np
from numpy.typing import NDArray

from bridge.wire.refusal import Tally
from estimator.gyro import COARSE_STEP
from estimator.loops import second as loop
from estimator.stillness import Window
from estimator.track.unseen import HOLE, unseen

Floats = NDArray[np.float64]
#: a window, and whether it is still for all that is known of those around it
Judged = tuple[Window, bool]
#: rad/s, no gyro rounds its readings so coarsely that more noise than this does not show
_COARSEST = radians(2.0)
_NONE = np.empty((0, 3))


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


@dataclass(frozen=True, slots=True, eq=False)
class Second:
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

    def __len__(self) -> int:
        return len(self.dt)


class Seconds:
    """Windows in, seconds out; the cut depends on the samples alone."""

    def __init__(self, knobs: SecondKnobs | None = None) -> None:
        self.knobs = knobs or SecondKnobs()
        self.refused = Tally()
        self._windows: list[Judged] = []
        self._coming: list[Judged] = []
        self._moved = -np.inf  # when the last window ended that was not still
        self._last_time = float("nan")
        self._last: tuple[Floats, Floats | None] | None = None  # the reading at that time
        self._step = np.full(3, np.inf)  # the least ever seen
        self._noisy = np.zeros(3, bool)  # axes that never repeat themselves at rest
        self._all_noisy = False

    def window(self, window: Window, noise_std: Floats) -> list[Second]:
        """The seconds that are known whole after the next window; noise_std (3,) rad/s of a reading."""
        if window.spikes:
            self.refused.add("spike", window.spikes)
        # A movement begins and ends too gently for those windows to tell: what seems still waits to see how it goes on.
        now, settle_s = window.end_time, self.knobs.settle_s
        if not window.still:
            self._coming = [(before, False) for before, _ in self._coming]
            self._moved = now
        coming = self._coming
        coming.append((window, window.start_time - self._moved >= settle_s))
        whole, taken = list[Second](), 0
        for judged, still in coming:
            if still and now - judged.end_time < settle_s:  # movement is judged for good at once
                break
            taken += 1
            self._take(judged, noise_std, whole, still=still)
        del coming[:taken]
        return whole

    def skip(self, window: Window) -> None:
        """Let the next window go by, and those that wait."""
        self._windows, self._coming = [], []
        self._last_time, self._last = window.end_time, _last(window)

    def _take(self, window: Window, noise_std: Floats, whole: list[Second], *, still: bool) -> None:
        windows = self._windows
        if windows and windows[-1][1] != still and window.start_time - windows[0][0].start_time >= self.knobs.least_s:
            whole.append(self._close(noise_std))
            windows = self._windows
        windows.append((window, still))
        if window.end_time - windows[0][0].start_time >= self.knobs.length_s:
            whole.append(self._close(noise_std))

    def _close(self, noise_std: Floats) -> Second:
        windows, still = [window for window, _ in self._windows], all(still for _, still in self._windows)
        self._windows = []
        time, gyro = np.concatenate([w.time for w in windows]), np.concatenate([w.gyro for w in windows])
        forces = [w.accel for w in windows if w.accel is not None]
        accel = np.concatenate(forces) if len(forces) == len(windows) else None
        first = self._last_time if isfinite(self._last_time) else float(time[0] - np.median(np.diff(time)))
        dt, rows = loop.measured(
            time, gyro, _NONE if accel is None else accel, first, _COARSEST, COARSE_STEP, self._step
        )
        least_std, longest, strength = rows[loop.SCALARS].tolist()
        self._last_time = float(time[-1])
        before, self._last = self._last or _first(windows[0]), _last(windows[-1])
        if still and not self._all_noisy:
            # From one reading to the next: a slow sway is no noise.
            self._noisy |= rows[loop.JITTER] > np.sqrt(2) * self._step
            self._all_noisy = bool(self._noisy.all())
        flaw = self._flaw(windows, longest, least_std, rows, noise_std)
        whole = longest * len(dt) <= HOLE * (self._last_time - first)
        return Second(
            start=first,
            end=self._last_time,
            dt=dt,
            gyro=gyro,
            accel=accel,
            still=still,
            flaw=flaw,
            mean=rows[loop.MEAN],
            std=rows[loop.STD],
            mean_var=rows[loop.MEAN_VAR],
            common_var=rows[loop.COMMON_VAR],
            accel_mean=None if accel is None else rows[loop.ACCEL_MEAN],
            accel_std=None if accel is None else rows[loop.ACCEL_STD],
            accel_strength=strength,
            unseen_turn=0.0 if whole else unseen(dt, gyro, before[0]),
            unseen_push=0.0
            if whole or accel is None
            else unseen(dt, accel, accel[0] if before[1] is None else before[1]),
        )

    def _flaw(self, windows: list[Window], longest: float, least_std: float, rows: Floats, noise_std: Floats) -> str:
        if np.concatenate([window.clipped for window in windows]).any():
            return "clipped"
        if longest > self.knobs.gap_s:
            return "gap"
        if least_std > 1e-9:
            return ""
        # A gyro coarser than its noise may well repeat itself at rest; one that showed noise before may not.
        noisy = self._noisy | (noise_std > self._step / 2) & (noise_std > 1e-6)
        return "stuck" if ((rows[loop.HELD] == 1) & noisy).any() else ""


def _first(window: Window) -> tuple[Floats, Floats | None]:
    return window.gyro[0], None if window.accel is None else window.accel[0]


def _last(window: Window) -> tuple[Floats, Floats | None]:
    return window.gyro[-1], None if window.accel is None else window.accel[-1]
