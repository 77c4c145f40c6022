"""What a subscriber was given, held against what was promised. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import pairwise

from tests.bench.network.guarded import Heard

#: the one that has a device says so five times a second
HANDED_OVER_S = 0.5


@dataclass(frozen=True, slots=True)
class Verdict:
    """Counts of samples; gap_s: the longest silence of a device."""

    samples: int
    lost: int
    twice: int
    out_of_order: int
    good_twice: int
    older: int
    late: int
    gap_s: float

    @property
    def broken(self) -> str:
        """Which promises were, each with its samples or batches; empty where all were kept."""
        counts = {
            "lost": self.lost,
            "given twice": self.twice,
            "out of order": self.out_of_order,
            "GOOD twice": self.good_twice,
            "of an older epoch": self.older,
        }
        return ", ".join(f"{n:,} {what}" for what, n in counts.items() if n)


def judged(heard: Heard, since_s: float) -> Verdict:
    """Of what came since a time."""
    boots = heard.by_boot(since_s)
    lost = twice = disordered = good_twice = older = 0
    gap_s = 0.0
    for batches in boots.values():
        good: set[int] = set()
        for before, after in pairwise(batches):
            step = after["first"] - before["first"] - before["n"]
            lost, twice = lost + max(0, step), twice + max(0, -step)
            disordered += after["first"] < before["first"]
            older += after["epoch"] < before["epoch"]
            gap_s = max(gap_s, after["at"] - before["at"])
        for batch in batches:
            numbers = set(range(batch["first"], batch["first"] + batch["n"])) if batch["good"] else set()
            good_twice += len(good & numbers)
            good |= numbers
    came = [batch for batches in boots.values() for batch in batches]
    return Verdict(
        samples=sum(batch["n"] for batch in came),
        lost=max(lost, sum(miss["n"] for miss in heard.misses if miss["at"] >= since_s)),
        twice=twice,
        out_of_order=disordered,
        good_twice=good_twice,
        older=older,
        late=sum(batch["old"] for batch in came),
        gap_s=gap_s,
    )


def disputed_until(heard: Iterable[Heard], devices: Collection[str], since_s: float, now_s: float) -> float:
    """When a device last had two owners or none for longer than it takes to hand one over; `since_s`: it never was so since."""
    last_s = since_s
    for one in heard:
        held: dict[str, set[str]] = {}
        begun: dict[str, float] = {}
        for said in list(one.owned):
            held[said["estimator"]] = set(said["held"])
            for device in devices:
                if sum(device in theirs for theirs in held.values()) != 1:
                    begun.setdefault(device, said["at"])
                elif (began_s := begun.pop(device, None)) is not None and said["at"] - began_s > HANDED_OVER_S:
                    last_s = max(last_s, said["at"])
        if any(now_s - began_s > HANDED_OVER_S for began_s in begun.values()):
            last_s = now_s  # it still is
    return last_s
