"""The latest moves of devices between estimators, each with its reason, for `truerate cluster status`. Pure."""

from collections import deque
from collections.abc import Callable

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Move

#: most moves remembered
_LATEST = 8


class Moves:
    """Moves of one estimator's devices. now_ns: the host's clock."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self.latest: deque[Move] = deque(maxlen=_LATEST)

    def came(self, devices: int, why: Sentences) -> None:
        """Add devices that came; those that come one after the other for the same reason are one move."""
        if self.latest and self.latest[-1].came and self.latest[-1].reason == why:
            devices += self.latest.pop().came
        self.latest.append(Move(self._now_ns(), devices, 0, why))

    def left(self, devices: int, taker: str) -> None:
        """Add devices that another estimator took."""
        self.latest.append(Move(self._now_ns(), 0, devices, (Code.ESTIMATOR_TOOK(estimator=taker),)))
