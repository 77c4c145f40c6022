"""Which samples of a device were published before it had a session: they come once more, to be taken in. Pure."""

from estimator.device.sequence import Sequence


class Foretold:
    """Those of a boot from number `begin` up to before `end`."""

    def __init__(self, boot: int, begin: int, end: int) -> None:
        self._boot, self._begin, self._end = boot, begin, end
        #: where a session that has failed before it had a boot goes on
        self._settled = begin

    def has(self, boot: int, sequence: int, n: int) -> bool:
        """Whether these are all among them."""
        return boot == self._boot and self._begin <= sequence and sequence + n <= self._end

    def over(self, boot: int, following: int) -> bool:
        """Whether who has come so far has passed them all."""
        return boot != self._boot or following > self._end

    def settle(self, sequence: Sequence, lost: int, uncounted: int) -> int:
        """A session fails: how many are among its last `lost` samples and the `uncounted` ones that it was about to take."""
        if sequence.boot not in (None, self._boot):
            return 0
        following = self._settled if sequence.next is None else sequence.next
        self._settled = following + uncounted
        return max(0, min(self._settled, self._end) - max(following - lost, self._begin))
