"""What of all that devices sent a subscriber did not get, and whether anything that was done may have cost it. Pure."""

from collections.abc import Iterator
from typing import NamedTuple

from tests.nemesis.history import Boot, Done, History, Sent

#: what is on its way to who may lose it, and is read again by who comes back, s
_BEFORE_S, _AFTER_S = 2.0, 1.0


class Hole(NamedTuple):
    """Samples first to last, both included, and from when to when they were sent, monotonic s."""

    boot: Boot
    first: int
    last: int
    begin_s: float
    end_s: float

    def __str__(self) -> str:
        (device, boot), samples = self.boot, self.last + 1 - self.first
        return f"{device}, boot {boot:016x}: {samples} samples from {self.first} on"


def holes(history: History) -> Iterator[Hole]:
    """All there are, beginnings, ends and whole boots among them."""
    for boot, sent in history.sent.items():
        due = 0
        for _, batch in history.heard.get(boot, ()):
            if batch.sequence > due:
                yield _hole(boot, sent, due, batch.sequence - 1)
            due = max(due, batch.sequence + len(batch))
        if due < sent[-1].samples:
            yield _hole(boot, sent, due, sent[-1].samples - 1)


def lost(history: History) -> Iterator[str]:
    """Samples that nothing that was done may have cost."""
    for hole in holes(history):
        if not any(_cost(done, hole, history.done) for done in history.done):
            since_s = hole.begin_s - min((done.begin_s for done in history.done), default=hole.begin_s)
            yield f"{hole} are lost, sent for {hole.end_s - hole.begin_s:.2f} s from {since_s:.2f} s on, by nothing that was done"


def invented(history: History) -> Iterator[str]:
    """Samples that no device has sent."""
    for boot, heard in history.heard.items():
        sent = history.sent[boot][-1].samples if boot in history.sent else 0
        until = max(batch.sequence + len(batch) for _, batch in heard)
        if until > sent:
            yield f"{boot[0]}, boot {boot[1]:016x}: sample {until - 1} of {sent} that were sent"


def _hole(boot: Boot, sent: list[Sent], first: int, last: int) -> Hole:
    return Hole(boot, first, last, _sent_s(sent, first), _sent_s(sent, last))


def _sent_s(sent: list[Sent], sample: int) -> float:
    return next(at_s for at_s, samples in sent if samples > sample)


def _cost(done: Done, hole: Hole, all_done: list[Done]) -> bool:
    """Whether a fault may have cost what was sent then.

    What was held up already when it began may be lost by it, too: since another fault began that was under way.
    """
    if done.costs not in {"", hole.boot[0]}:
        return False
    near_s = done.begin_s - _BEFORE_S
    since_s = min(other.begin_s for other in all_done if other.begin_s <= done.begin_s and other.end_s >= near_s)
    return min(since_s, near_s) <= hole.end_s and hole.begin_s <= done.end_s + _AFTER_S
