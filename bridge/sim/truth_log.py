"""Log of the true values of sent samples, by boot and sequence number, up to a number of samples."""

from collections import deque
from threading import Lock

import numpy as np

from bridge.sim.imu_errors import Truth
from bridge.sim.sample_source import TrueSamples

_BOOTS_KEPT = 64


class TruthLog:
    """Log of a device's true values, to judge estimates: the last `limit` samples, by boot and sequence number.

    May be used from any thread.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._lock = Lock()
        self._blocks: deque[tuple[int, int, TrueSamples]] = deque()
        self._held = 0
        self._boots: dict[int, Truth] = {}

    def begin(self, boot: int, truth: Truth | None) -> None:
        """Store the true sensor parameters of a new boot; None stores nothing. boot: 64-bit boot number."""
        with self._lock:
            if truth is not None:
                self._boots[boot] = truth
            while len(self._boots) > _BOOTS_KEPT:
                del self._boots[next(iter(self._boots))]

    def add(self, boot: int, sequence: int, truth: TrueSamples) -> None:
        """Store the true values of consecutive samples of a boot.

        sequence: number of the first sample since boot, from 0, not wrapped.
        """
        with self._lock:
            self._blocks.append((boot, sequence, truth))
            self._held += len(truth.rate)
            while self._held > self._limit and len(self._blocks) > 1:
                self._held -= len(self._blocks.popleft()[2].rate)

    def sensor(self, boot: int) -> Truth:
        """Return the true sensor parameters of a boot; raises LookupError for an unknown boot."""
        with self._lock:
            return self._boots[boot]

    def between(self, boot: int, first: int, last: int) -> TrueSamples:
        """Return the true values of samples `first` to `last` of a boot, both included, by sequence number.

        Raises LookupError if the log does not have all of them.
        """
        with self._lock:
            blocks = [
                (begin, truth)
                for of, begin, truth in self._blocks
                if of == boot and begin <= last and first < begin + len(truth.rate)
            ]
        parts = [truth[max(0, first - begin) : last + 1 - begin] for begin, truth in blocks]
        n = sum(len(part.rate) for part in parts)
        if n != last + 1 - first or n == 0:
            raise LookupError(
                f"truth of samples {first} to {last} of boot {boot:016x} is not kept: the log has only {n} of these samples"
            )
        return TrueSamples(
            rate=np.concatenate([part.rate for part in parts]),
            attitude=np.concatenate([part.attitude for part in parts]),
            bias=np.concatenate([part.bias for part in parts]),
        )
