"""What of one device was corrected and published ahead of its session, which takes it in before anybody looks at it."""

from collections.abc import Callable

from estimator.correction import Correction


class Ahead:
    """One device's, small: of all that is kept of a device only this is needed for a message that only goes on."""

    __slots__ = ("correction", "heard", "held", "place", "put", "sure")

    def __init__(self, heard: float) -> None:
        #: messages that its session has not taken in
        self.held: list[bytes] = []
        #: when its last sign of life came
        self.heard = heard
        #: whether nobody had its session since that was seen to go on where its sender stands
        self.sure = False
        #: its place among the senders, and what stands there
        self.place = -1
        self.correction: Correction | None = None
        #: publishes what is corrected
        self.put: Callable[[bytes], None] = _nowhere

    def release(self) -> tuple[bytes, ...]:
        """All that is held, once."""
        held = tuple(self.held)  # which Python's search for cycles soon passes over, as no list
        self.held.clear()
        return held


def _nowhere(payload: bytes) -> None:
    raise RuntimeError(f"{len(payload)} bytes of a device that is not announced")
