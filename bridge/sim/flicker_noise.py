"""Bias instability: flicker noise, the floor of the Allan deviation, as a sum of Gauss-Markov processes.

S(f) = B² / (π f), one-sided, from 1 / (2 π longest) to 1 / (2 π shortest) hertz. The Allan deviation is then flat at
sqrt(2 ln 2 / π) B = 0.664 B in between (IEEE Std 952-1997, B.4.2). The time constants are evenly spaced in the
logarithm; each process has the power of its share of the spectrum.
"""

import numpy as np

from bridge.sim.quaternion import Array

_SHORTEST_S, _LONGEST_S, _PER_DECADE = 0.5, 20_000.0, 3
_STRETCH_S = 5.0  # within which the shortest process does not decay below float resolution


class Flicker:
    """Flicker noise on three axes, with bias instability B (`instability`, whose unit the noise has), drawn from rng.

    Call `at` in order, in any batches.
    """

    def __init__(self, instability: float, rng: np.random.Generator) -> None:
        n = round(np.log10(_LONGEST_S / _SHORTEST_S) * _PER_DECADE) + 1
        self._tau_s = np.geomspace(_SHORTEST_S, _LONGEST_S, n)[:, None]
        ratio = self._tau_s[1, 0] / self._tau_s[0, 0]
        self._std = instability * np.sqrt(np.log(ratio) / np.pi)
        self._rng = rng
        self._state = self._std * rng.normal(size=(n, 3))
        self._time_s = 0.0

    def at(self, time_s: Array) -> Array:
        """Return noise (n, 3) at times (n,) in s, rising and later than all before; all times are > 0."""
        parts, begin = [], 0
        while begin < len(time_s):
            end = int(np.searchsorted(time_s, max(self._time_s, time_s[begin]) + _STRETCH_S, side="right"))
            parts.append(self._stretch(time_s[begin:end]))
            begin = end
        return np.concatenate(parts)

    def _stretch(self, time_s: Array) -> Array:
        dt = np.diff(time_s, prepend=self._time_s)
        if dt[0] > _STRETCH_S:  # a gap, whose values need not be drawn
            self._step(float(dt[0]), self._rng.normal(size=self._state.shape))
            dt[0] = 0.0
        fresh = self._rng.normal(size=(len(dt), *self._state.shape))
        kept = np.exp(-dt / self._tau_s)  # (tau, n)
        # x[i] = kept[i] x[i-1] + new[i], solved at once: x[i] / all_kept[i] is a cumulative sum.
        all_kept = np.exp(-np.cumsum(dt) / self._tau_s)[:, :, None]
        new = (self._std * np.sqrt(1 - kept**2))[:, :, None] * fresh.transpose(1, 0, 2)
        x = all_kept * (self._state[:, None, :] + np.cumsum(new / all_kept, axis=1))
        self._state, self._time_s = x[:, -1, :], float(time_s[-1])
        return np.asarray(x.sum(axis=0))

    def _step(self, dt_s: float, fresh: Array) -> None:
        kept = np.exp(-dt_s / self._tau_s)
        self._state = kept * self._state + self._std * np.sqrt(1 - kept**2) * fresh
