"""Nothing of an older epoch after a newer one: a former estimator of a device that wakes up is not listened to. Pure.

`Fence` is for what is said now and then, `Turns` for samples, which have numbers.

An epoch is of an estimator's turn at a device; a later turn has a higher number. The newest is forgotten when only older ones
have come for a while: a machine whose clock was set back, and so makes lower numbers, must not be shut out for ever. A while in
which nothing comes is no reason: what a bad line held up may be older.
"""

from dataclasses import dataclass

#: only older epochs came for so long, s
FORGET_S = 5.0
_TURNS = 8


class Fence:
    """Epochs of a bounded number of devices."""

    def __init__(self, devices: int = 4096) -> None:
        self._devices = devices
        self._newest: dict[str, tuple[int, float | None]] = {}  # and since when only older ones came

    def admits(self, device: str, epoch: int, now: float) -> bool:
        """Whether what came of a device at `now`, seconds of a clock that does not go back, is of its newest epoch."""
        newest = self._newest.get(device)
        if newest is not None and epoch < newest[0]:
            since = now if newest[1] is None else newest[1]
            if now - since <= FORGET_S:
                self._newest[device] = newest[0], since
                return False
        if newest is None and len(self._newest) >= self._devices:
            del self._newest[next(iter(self._newest))]
        self._newest[device] = epoch, None
        return True


@dataclass(slots=True)
class _Turn:
    epoch: int
    first: int


class Turns:
    """Whose sample it is, of one boot: from the first number of a turn on, it is no earlier turn's.

    Below it it may be: that may have been under way for longer. What is said by who wakes up lies above it, since whoever
    takes a device over begins no later than where the other had come to.
    """

    def __init__(self, forget_s: float = FORGET_S) -> None:
        self._forget_s = forget_s
        self._turns: list[_Turn] = []  # the latest, by epoch
        self._older_s: float | None = None  # since when only older ones came

    @property
    def newest(self) -> int:
        """The epoch of the latest turn that is not forgotten."""
        return self._turns[-1].epoch if self._turns else 0

    def of(self, epoch: int, first: int, n: int, now: float) -> int:
        """Of n samples from number `first` on, that came at `now`, how many at the beginning are that turn's."""
        turns = self._turns
        if turns and epoch < turns[-1].epoch:
            self._older_s = now if self._older_s is None else self._older_s
            if now - self._older_s <= self._forget_s:
                later = min(turn.first for turn in turns if turn.epoch > epoch)
                self._note(epoch, first)
                return max(0, min(n, later - first))
            turns.clear()
        self._older_s = None
        self._note(epoch, first)
        return n

    def _note(self, epoch: int, first: int) -> None:
        for turn in self._turns:
            if turn.epoch == epoch:
                turn.first = min(turn.first, first)
                return
        self._turns.append(_Turn(epoch, first))
        self._turns.sort(key=lambda turn: turn.epoch)
        del self._turns[:-_TURNS]
