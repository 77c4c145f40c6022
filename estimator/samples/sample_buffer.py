"""Samples of one device and boot as columns, and the buffer that keeps them until they have taught what they can."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isnan

import numpy as np
from numpy.typing import NDArray

from bridge.wire.batches import packed_flags
from bridge.wire.messages import SampleBatch, SampleFlag

Floats = NDArray[np.float64]
Wholes = NDArray[np.int64]

#: columns of rows: device time, s; gyro, rad/s, as read; accel, m/s², NaN where there is none; 1 where the reading is clipped or
#: stuck, which tells nothing of rotation; °C, NaN where it is not known
TIME, GYRO, ACCEL, CLIPPED, CELSIUS, WIDTH = 0, slice(1, 4), slice(4, 7), 7, 8, 9
#: columns of places: sequence number; host time, ns since the Unix epoch; SampleFlags
SEQUENCE, HOST_NS, FLAGS = range(3)
#: flags of a reading that tells nothing of rotation
UNFIT = SampleFlag.CLIPPED | SampleFlag.STUCK
#: samples that a buffer has room for at first
_ROOM = 256


@dataclass(slots=True, eq=False)
class Samples:
    """n consecutive samples of one message, decoded: rows (n, 9) and places (n, 3), columns as above.

    ticks and flags are packed as on the wire, no flags where none is set.
    first_s, last_s: when the first and the last sample were taken, by the device's clock.
    """

    device: str
    bridge: str
    boot: int
    sequence: int
    n: int
    first_s: float
    last_s: float
    receive_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: bytes
    flags: bytes
    rows: Floats
    places: Wholes

    @classmethod
    def of(cls, batch: SampleBatch) -> "Samples":
        """The samples of a batch."""
        n = len(batch)
        rows, places = np.full((n, WIDTH), np.nan), np.empty((n, 3), np.int64)
        rows[:, TIME], rows[:, GYRO] = batch.device_time, batch.gyro
        rows[:, CLIPPED] = (batch.flags & np.uint32(UNFIT)) != 0
        if batch.accel is not None:
            rows[:, ACCEL] = batch.accel
        if batch.temperature_c is not None:
            stepped = (batch.flags & np.uint32(SampleFlag.TEMPERATURE_STEP)) != 0
            rows[:, CELSIUS] = np.where(stepped, np.nan, batch.temperature_c)
        passed_s = (batch.ticks - batch.ticks[0]).astype(float) * batch.tick_period_s * batch.clock_rate
        places[:, SEQUENCE] = batch.sequence + np.arange(n)
        places[:, HOST_NS] = batch.start_time_ns + np.rint(passed_s * 1e9).astype(np.int64)
        places[:, FLAGS] = batch.flags
        which = batch.device, batch.bridge, batch.boot, batch.sequence, n, rows.item(0, TIME), rows.item(-1, TIME)
        clock = batch.receive_time_ns, batch.tick_period_s, batch.clock_rate
        return cls(*which, *clock, batch.ticks.tobytes(), packed_flags(batch.flags), rows, places)

    @property
    def last_ns(self) -> int:
        """Host time of the last sample, ns since the Unix epoch."""
        return self.places.item(-1, HOST_NS)

    @property
    def celsius(self) -> float | None:
        """Temperature at the first sample; None where it is not known."""
        return known(self.rows.item(0, CELSIUS))

    def part(self, first: int, end: int) -> "Samples":
        """Samples first to end of them."""
        rows, places = self.rows[first:end], self.places[first:end]
        return replace(
            self,
            sequence=self.sequence + first,
            n=end - first,
            first_s=rows.item(0, TIME),
            last_s=rows.item(-1, TIME),
            ticks=self.ticks[8 * first : 8 * end],
            flags=self.flags[4 * first : 4 * end],
            rows=rows,
            places=places,
        )


class SampleBuffer:
    """Samples of one boot, numbered from `first` on in the order they came; rows that were read are not written to again."""

    def __init__(self, first: int = 0) -> None:
        self._first = first  # the number of the first sample that there is room for
        self._begin = self._end = 0  # where in that room the samples are
        self._rows, self._places = np.empty((_ROOM, WIDTH)), np.empty((_ROOM, 3), np.int64)

    @property
    def begin(self) -> int:
        """The number of the first sample that is not forgotten."""
        return self._first + self._begin

    @property
    def end(self) -> int:
        """The number that the next sample will have."""
        return self._first + self._end

    def put(self, parts: Sequence[tuple[Floats, Wholes]]) -> None:
        """Take samples, rows (n, 9) and places (n, 3) of each part."""
        rows, places = zip(*parts, strict=True)
        n = sum(map(len, rows))
        if self._end + n > len(self._rows):
            self._make_room(n)
        begin, self._end = self._end, self._end + n
        np.concatenate(rows, out=self._rows[begin : self._end])
        np.concatenate(places, out=self._places[begin : self._end])

    def rows(self, begin: int, end: int) -> Floats:
        """Samples by their numbers."""
        return self._rows[begin - self._first : end - self._first]

    def places(self, begin: int, end: int) -> Wholes:
        """The places (n, 3) of the same."""
        return self._places[begin - self._first : end - self._first]

    def place(self, number: int) -> tuple[int, int]:
        """Sequence number and host time of a sample that is not forgotten."""
        at = number - self._first
        if not self._begin <= at < self._end:
            raise IndexError(f"sample {number} is not in the buffer: {self._first + self._begin} to {self.end - 1} are")
        return self._places.item(at, SEQUENCE), self._places.item(at, HOST_NS)

    def forget(self, number: int) -> None:
        """Samples before this number are needed no longer."""
        self._begin = max(self._begin, number - self._first)

    def _make_room(self, more: int) -> None:
        kept = self._end - self._begin
        size = max(_ROOM, 2 * (kept + more))
        rows, places = np.empty((size, WIDTH)), np.empty((size, 3), np.int64)
        rows[:kept], places[:kept] = self._rows[self._begin : self._end], self._places[self._begin : self._end]
        self._rows, self._places = rows, places
        self._first += self._begin
        self._begin, self._end = 0, kept


def known(celsius: float) -> float | None:
    """A temperature as it stands in a row; None where it is not known."""
    return None if isnan(celsius) else celsius
