"""How warm a worn sensor is: the room, its own heat after power-up, and the skin's while it is worn. Drawn from a seed."""

from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.sim.quaternion import Array

ROOM_C, SKIN_C = 23.0, 33.0
_SKIN_S = (480.0, 720.0)
_OWN_K, _OWN_S = (0.5, 2.5), (60.0, 300.0)
#: the room, and the covers, over an hour or so
_WANDER_K = 0.6


class Temperature(Protocol):
    """A sensor's temperature."""

    def at(self, time_s: Array, worn: NDArray[np.bool_]) -> Array:
        """°C (n,) at times (n,) s since power-up, rising, worn or not during the interval that ends then."""


class Warmth:
    """The temperature of one boot's sensor; fed in order."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._skin_s, self._own_k, self._own_s = (float(rng.uniform(*ends)) for ends in (_SKIN_S, _OWN_K, _OWN_S))
        self._wander_s, self._phase = rng.uniform(1800, 9000, 3), rng.uniform(0, 2 * np.pi, 3)
        self._skin_k = 0.0
        self._time_s = 0.0

    def at(self, time_s: Array, worn: NDArray[np.bool_]) -> Array:
        """See Temperature."""
        skin_k = np.empty(len(time_s))
        edges = np.concatenate([[0], np.flatnonzero(np.diff(worn)) + 1, [len(time_s)]])
        for begin, end in pairwise(edges):
            target = (SKIN_C - ROOM_C) * worn[begin]
            since = time_s[begin:end] - self._time_s
            skin_k[begin:end] = target + (self._skin_k - target) * np.exp(-since / self._skin_s)
            self._skin_k, self._time_s = float(skin_k[end - 1]), float(time_s[end - 1])
        own_k = self._own_k * -np.expm1(-time_s / self._own_s)
        waves = np.sin(2 * np.pi * time_s[:, None] / self._wander_s + self._phase) - np.sin(self._phase)
        return np.asarray(ROOM_C + skin_k + own_k + _WANDER_K * waves.mean(axis=1))
