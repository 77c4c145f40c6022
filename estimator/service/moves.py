"""Log of the latest moves of devices between estimators, with reasons, for `truerate cluster status`. Pure."""

from collections import deque
from collections.abc import Callable

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Move

#: most moves remembered
_LATEST = 8


class Moves:
    """Log of the latest moves of devices to and from one estimator; `latest`: oldest first.

    now_ns: the host's clock, ns since the Unix epoch.
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self.latest: deque[Move] = deque(maxlen=_LATEST)

    def came(self, devices: int, why: Sentences) -> None:
        """Record that this estimator took over `devices` devices, and the reason.

        Consecutive takeovers for the same reason count as one move.
        """
        if self.latest and self.latest[-1].came and self.latest[-1].reason == why:
            devices += self.latest.pop().came
        self.latest.append(Move(self._now_ns(), devices, 0, why))

    def left(self, devices: int, taker: str) -> None:
        """Record that the estimator `taker` took `devices` devices from this one."""
        self.latest.append(Move(self._now_ns(), 0, devices, (Code.ESTIMATOR_TOOK(estimator=taker),)))
