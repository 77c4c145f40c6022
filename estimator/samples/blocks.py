"""Device time cut into blocks of a second, at the same samples however those were batched."""

from bisect import bisect_left
from collections.abc import Iterable, Iterator

from estimator.samples.sample_buffer import SEQUENCE, TIME, Floats, SampleBuffer, Samples, Wholes

#: length of a block, s: a second; half of one while somebody waits for what comes of a calibration's first rest, or of turns
BLOCK_S, SHORT_S = 1.0, 0.5
#: device time that is taken to have passed when a bridge, started anew, has lost count of the turns of the device's clock
CLOCK_LOST_S = 1.0


class Blocks:
    """The samples of one boot from a device time on, s: those of blocks that are over are in `buffer`.

    `latest` is the device time of the last sample.
    """

    def __init__(self, began: float) -> None:
        self.buffer = SampleBuffer()
        self.latest = began
        #: length of the blocks that begin from here on, s; they end where device time is a multiple of it
        self.length_s = SHORT_S
        self._block: list[tuple[Floats, Wholes]] = []  # that is not over
        self._first_s: float | None = None
        self._later_s = 0.0  # device time is later than the device's clock, which went back, by so much
        self._end_after(began)

    def anew(self) -> "Blocks":
        """Of the same boot from here on; the samples so far are forgotten."""
        anew = Blocks(self.latest)
        anew._first_s, anew._later_s = self._first_s, self._later_s
        return anew

    @property
    def begun(self) -> tuple[float, int] | None:
        """Device time and sequence number of the first sample of the block that is not over; None before there is one."""
        return (self._block[0][0].item(0, TIME), self._block[0][1].item(0, SEQUENCE)) if self._block else None

    @property
    def clock(self) -> tuple[float | None, float]:
        """Device time of the first sample, and by how much device time is later than the device's clock."""
        return self._first_s, self._later_s

    def resume(self, buffer: SampleBuffer, clock: tuple[float | None, float], begun: float | None) -> None:
        """Go on with these samples, where a block of the present length begins at a device time, if that is known."""
        self.buffer, (self._first_s, self._later_s) = buffer, clock
        if begun is not None:
            self._end_after(begun)

    @property
    def seconds(self) -> float:
        """From the first sample to the last."""
        return 0.0 if self._first_s is None else self.latest - self._first_s

    def went_back(self, first_s: float, away_s: float) -> bool:
        """Whether the device's clock has; from here on it is taken to go on, by what the host has seen pass at least."""
        if self._first_s is None or first_s + self._later_s > self.latest:
            return False
        self._later_s += self.latest + max(CLOCK_LOST_S, away_s) - (first_s + self._later_s)
        return True

    def put(self, samples: Samples, skip: int = 0) -> Iterable[tuple[int, float, float]]:
        """Take samples but the first few. Of each that begins a block: its place, its device time, and that of the one before.

        Who is told ends a block there, and may change `length_s`.
        """
        rows, places = (samples.rows[skip:], samples.places[skip:]) if skip else (samples.rows, samples.places)
        if self._later_s:
            rows = rows.copy()
            rows[:, TIME] += self._later_s
        if self._first_s is None:
            self._first_s = rows.item(0, TIME)
        before, self.latest = self.latest, samples.last_s + self._later_s
        if self.latest < self._until:
            self._block.append((rows, places))
            return ()
        return self._edges(rows, places, skip, before)

    def _edges(self, rows: Floats, places: Wholes, skip: int, before: float) -> Iterator[tuple[int, float, float]]:
        times, begin = rows[:, TIME].tolist(), 0
        edge = bisect_left(times, self._until)
        while edge < len(times):
            if edge > begin:
                self._block.append((rows[begin:edge], places[begin:edge]))
            begin = edge
            yield skip + edge, times[edge], times[edge - 1] if edge else before
            self._end_after(times[edge])
            edge = bisect_left(times, self._until, edge + 1)
        self._block.append((rows[begin:], places[begin:]))

    def end_block(self) -> tuple[int, int] | None:
        """The block is over: the numbers of its first sample and of the one after its last, in `buffer`; None of an empty one."""
        if not self._block:
            return None
        begin = self.buffer.end
        self.buffer.put(self._block)
        self._block = []
        return begin, self.buffer.end

    def own(self) -> None:
        """Copy the block that is not over: all that was decoded in the same rounds need not stay for a device that is silent."""
        self._block = [(rows.copy(), places.copy()) for rows, places in self._block]

    def _end_after(self, begun: float) -> None:
        self._until = (begun // self.length_s + 1) * self.length_s
