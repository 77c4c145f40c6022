"""Cutting of samples into blocks of half a second or a second of device time, so that each block is processed at once.

The block boundaries are at the same samples, however the samples are split into messages.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator

from estimator.samples.sample_buffer import SEQUENCE, TIME, Floats, SampleBuffer, Samples, Wholes

#: length of a block, s; SHORT_S while a user waits for the result of a calibration's first rest, or of its turns
BLOCK_S, SHORT_S = 1.0, 0.5
#: least device time, s, assumed to have passed when a restarted bridge has lost count of the device clock's wraps
CLOCK_LOST_S = 1.0


class Blocks:
    """Cutter of the samples of one boot into blocks of device time; finished blocks go to `buffer`.

    began: device time at the start, s.
    `length_s`: length of blocks from now on, s; blocks end where device time is a multiple of it. `latest`: device time
    of the last sample, s.
    """

    def __init__(self, began: float) -> None:
        self.buffer = SampleBuffer()
        self.latest = began
        #: length of blocks that begin from now on, s; a block ends where device time is a multiple of the length
        self.length_s = SHORT_S
        self._block: list[tuple[Floats, Wholes]] = []  # the unfinished block
        self._first_s: float | None = None
        self._later_s = 0.0  # device time minus device clock, after the clock went back
        self._end_after(began)

    def anew(self) -> "Blocks":
        """Return a cutter for the same boot that continues after the latest sample, without the samples held so far."""
        anew = Blocks(self.latest)
        anew._first_s, anew._later_s = self._first_s, self._later_s
        return anew

    @property
    def begun(self) -> tuple[float, int] | None:
        """Device time, s, and sequence number of the first sample of the unfinished block; None while it is empty."""
        return (self._block[0][0].item(0, TIME), self._block[0][1].item(0, SEQUENCE)) if self._block else None

    @property
    def clock(self) -> tuple[float | None, float]:
        """Device time of the first sample (None before it), and device time minus the device's clock; both in s.

        Device time always rises. The difference is above 0 once the device's clock went back: see `went_back`.
        """
        return self._first_s, self._later_s

    def resume(self, buffer: SampleBuffer, clock: tuple[float | None, float], begun: float | None) -> None:
        """Continue from saved samples and a saved clock.

        buffer: the saved samples. clock: a value of the property `clock`.
        begun: device time at which the present block begins, s, or None.
        """
        self.buffer, (self._first_s, self._later_s) = buffer, clock
        if begun is not None:
            self._end_after(begun)

    @property
    def seconds(self) -> float:
        """Device time from the first sample to the last, s; 0 before the first sample."""
        return 0.0 if self._first_s is None else self.latest - self._first_s

    def went_back(self, first_s: float, away_s: float) -> bool:
        """Return True if the device's clock went back; device time is then shifted so that it continues to rise.

        first_s: device clock of the sample that follows the latest one, s.
        away_s: least time since the last sample according to the host, s.
        """
        if self._first_s is None or first_s + self._later_s > self.latest:
            return False
        self._later_s += self.latest + max(CLOCK_LOST_S, away_s) - (first_s + self._later_s)
        return True

    def put(self, samples: Samples, skip: int = 0) -> Iterable[tuple[int, float, float]]:
        """Add samples, without the first `skip`, and report each block boundary.

        Yields three values for the first sample of each new block. They are its index in `samples`, its device time
        (s), and the device time of the sample before (s). At each boundary the caller must call `end_block`, and may
        change `length_s`.
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
        """End the block and move its samples to `buffer`.

        Returns the number of its first sample and that of the sample after its last, in the numbering of `buffer`.
        Returns None for an empty block.
        """
        if not self._block:
            return None
        begin = self.buffer.end
        self.buffer.put(self._block)
        self._block = []
        return begin, self.buffer.end

    def own(self) -> None:
        """Copy the samples of the unfinished block out of the larger arrays of which they are views.

        Otherwise a silent device would keep these arrays, with the samples of many devices, in memory.
        """
        self._block = [(rows.copy(), places.copy()) for rows, places in self._block]

    def _end_after(self, begun: float) -> None:
        self._until = (begun // self.length_s + 1) * self.length_s
