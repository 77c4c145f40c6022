"""A stream cut into seconds, each judged fit or not; what is no measurement never gets behind this door.

A reading alone far from both its neighbours is replaced by their mean; a second with clipped or stuck readings, or with a hole
in it, tells nothing of rotation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from bridge.wire.refusal import Tally
from estimator.gyro import least_step, spread
from estimator.stillness import Window

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


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
    #: a lone reading this far from the mean of its neighbours, and this many times farther than is usual, is a spike
    spike: float = radians(30.0)
    spike_factor: float = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Second:
    """A second of n samples from `start` (the time of the one before) to `end`: dt (n,) s, gyro and accel (n, 3).

    still: all of it was judged so. flaw: why it tells nothing of rotation, or nothing.
    mean, std, step (3,) of the readings; accel_mean, accel_std (3,) or None.
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
    step: Floats
    accel_mean: Floats | None
    accel_std: Floats | None

    def __len__(self) -> int:
        return len(self.dt)


class Seconds:
    """Samples and the windows over them in, seconds out; the cut depends on the samples alone."""

    def __init__(self, knobs: SecondKnobs | None = None) -> None:
        self.knobs = knobs or SecondKnobs()
        self.refused = Tally()
        self._samples: list[tuple[Floats, Floats, Floats | None, Flags]] = []
        self._windows: list[Window] = []
        self._coming: list[Window] = []
        self._moved = -np.inf  # when the last window ended that was not still
        self._last_time = float("nan")
        self._last_gyro = np.zeros((0, 3))

    def add(self, time: Floats, gyro: Floats, accel: Floats | None, clipped: Flags) -> None:
        """Hold samples (n,), (n, 3), (n, 3), (n,) until windows have judged them."""
        if len(time):
            self._samples.append((time, gyro, accel, clipped))

    def window(self, window: Window, noise_std: Floats) -> Iterator[Second]:
        """The seconds that are known whole after a window over the next samples; noise_std (3,) rad/s of a reading."""
        # A movement begins and ends too gently for those windows to tell: they wait to see how it goes on.
        if not window.still:
            self._coming = [replace(before, still=False) for before in self._coming]
            self._moved = window.end_time
        settled = window.start_time - self._moved >= self.knobs.settle_s
        self._coming.append(window if settled else replace(window, still=False))
        while window.end_time - self._coming[0].end_time >= self.knobs.settle_s:
            yield from self._take(self._coming.pop(0), noise_std)

    def skip(self, window: Window) -> None:
        """Let the samples of the next window go by, and those that wait."""
        waiting = sum(before.samples for before in (*self._windows, *self._coming))
        self._windows, self._coming = [], []
        time, gyro, _, _ = self._draw(waiting + window.samples)
        self._last_time, self._last_gyro = float(time[-1]), gyro[-1:]

    def _take(self, window: Window, noise_std: Floats) -> Iterator[Second]:
        turned = bool(self._windows) and self._windows[-1].still != window.still
        if turned and window.start_time - self._windows[0].start_time >= self.knobs.least_s:
            yield self._close(noise_std)
        self._windows.append(window)
        if window.end_time - self._windows[0].start_time >= self.knobs.length_s:
            yield self._close(noise_std)

    def _close(self, noise_std: Floats) -> Second:
        windows, self._windows = self._windows, []
        time, gyro, accel, clipped = self._draw(sum(window.samples for window in windows))
        first = self._last_time if np.isfinite(self._last_time) else time[0] - float(np.median(np.diff(time)))
        dt = np.diff(time, prepend=first)
        mended = self._despiked(time, gyro)
        self._last_time, self._last_gyro = float(time[-1]), mended[-1:]
        mean, std = spread(gyro)
        accel_mean, accel_std = (None, None) if accel is None else spread(accel)
        step = least_step(gyro)
        return Second(
            start=float(first),
            end=float(time[-1]),
            dt=dt,
            gyro=mended,
            accel=accel,
            still=all(window.still for window in windows),
            flaw=self._flaw(dt, gyro, step, clipped, noise_std),
            mean=mean,
            std=std,
            step=step,
            accel_mean=accel_mean,
            accel_std=accel_std,
        )

    def _draw(self, n: int) -> tuple[Floats, Floats, Floats | None, Flags]:
        """The first n held samples; the rest stays."""
        drawn = []
        while n > 0:
            time, gyro, accel, clipped = self._samples.pop(0)
            if len(time) > n:
                rest = (time[n:], gyro[n:], None if accel is None else accel[n:], clipped[n:])
                self._samples.insert(0, rest)
                time, gyro, accel, clipped = time[:n], gyro[:n], None if accel is None else accel[:n], clipped[:n]
            drawn.append((time, gyro, accel, clipped))
            n -= len(time)
        times, gyros, accels, flags = zip(*drawn, strict=True)
        known = [accel for accel in accels if accel is not None]
        both = np.concatenate(known) if len(known) == len(accels) else None
        return np.concatenate(times), np.concatenate(gyros), both, np.concatenate(flags)

    def _flaw(self, dt: Floats, gyro: Floats, step: Floats, clipped: Flags, noise_std: Floats) -> str:
        if clipped.any():
            return "clipped"
        if dt.max() > self.knobs.gap_s:
            return "gap"
        # A gyro coarser than its noise may well repeat itself at rest; one that showed noise before may not.
        if ((gyro == gyro[0]).all(axis=0) & (noise_std > step / 2) & (noise_std > 1e-6)).any():
            return "stuck"
        return ""

    def _despiked(self, time: Floats, gyro: Floats) -> Floats:
        """The readings (n, 3) with lone spikes mended; one before them and two after them are neighbours, too."""
        n = len(gyro)
        if n < 5:
            return gyro
        # Where there is no neighbour a reading is its own.
        before = self._last_gyro if time[0] - self._last_time <= self.knobs.gap_s else gyro[:1]
        near = bool(self._samples) and self._samples[0][0][0] - time[-1] <= self.knobs.gap_s
        after = self._following(2) if near else np.repeat(gyro[-1:], 2, axis=0)
        around = np.concatenate([before, gyro, after])
        between = 0.5 * (around[:-2] + around[2:])
        off = np.abs(around[1:-1] - between)
        if off.max() <= self.knobs.spike:
            return gyro
        # A spike also spoils its neighbours' means, by half of itself.
        worst = off >= np.maximum(off, np.maximum(np.roll(off, 1, axis=0), np.roll(off, -1, axis=0)))
        lone = worst & (off > self.knobs.spike) & (off > self.knobs.spike_factor * np.median(off, axis=0))
        lone, between = lone[:n], between[:n]
        if not lone.any():
            return gyro
        self.refused.add("spike", int(lone.any(axis=1).sum()))
        return np.where(lone, between, gyro)

    def _following(self, n: int) -> Floats:
        """(n, 3) the next readings that are held."""
        following: list[Floats] = []
        for _, gyro, _, _ in self._samples:
            following += list(gyro[: n - len(following)])
        return np.array(following)
