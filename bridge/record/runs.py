"""Which corrected samples have their readings in the same file: runs of consecutive numbers, laid over each other."""

from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass

from bridge.record.numbering import ANEW_NS


@dataclass(slots=True)
class Run:
    """Samples numbered from first to just before end, the first of them at time_ns, of one quality where that matters."""

    first: int
    end: int
    time_ns: int
    quality: str = ""


class Runs:
    """The runs of one boot, in the order in which they came."""

    def __init__(self) -> None:
        self._all: list[Run] = []

    def add(self, first: int, end: int, time_ns: int, quality: str = "") -> None:
        """What goes on where the last run ended makes it longer."""
        last = self._all[-1] if self._all else None
        if last is not None and last.end == first and last.quality == quality:
            last.end = end
        else:
            self._all.append(Run(first, end, time_ns, quality))

    def qualities(self) -> Counter[str]:
        """How many samples of each."""
        found: Counter[str] = Counter()
        for run in self._all:
            found[run.quality] += run.end - run.first
        return found

    def within(self, readings: "Runs") -> Counter[str]:
        """The same of those samples only whose readings are there."""
        found: Counter[str] = Counter()
        epochs = readings.epochs()
        begins = [epoch[0].time_ns for epoch in epochs]
        for run in self._all if epochs else ():
            epoch = epochs[max(0, bisect_right(begins, run.time_ns + ANEW_NS) - 1)]
            at = max(0, bisect_right(epoch, run.first, key=lambda other: other.first) - 1)
            while at < len(epoch) and epoch[at].first < run.end:
                found[run.quality] += max(0, min(run.end, epoch[at].end) - max(run.first, epoch[at].first))
                at += 1
        return found

    def epochs(self) -> list[list[Run]]:
        """Parted where numbers begin anew; within one they rise."""
        epochs: list[list[Run]] = []
        for run in self._all:
            if not epochs or run.first < epochs[-1][-1].end:
                epochs.append([])
            epochs[-1].append(run)
        return epochs
