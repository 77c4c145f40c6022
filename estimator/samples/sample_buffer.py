"""Samples of one device and boot as columns, and the buffer that holds them until the estimator has used them.

Columns of rows (n, 9): device time (s), gyro (3, rad/s), accelerometer (3, m/s², NaN without), clipped or stuck (0 or
1), temperature (°C, NaN when unknown).
Columns of places (n, 3): sequence number, host time (ns since the Unix epoch), flags.
"""

from collections.abc import Sequence
from math import isnan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.batches import packed_flags
from bridge.wire.messages import SampleBatch, SampleFlag

Floats = NDArray[np.float64]
Wholes = NDArray[np.int64]

#: columns of rows: device time, s; gyro reading, rad/s; accel, m/s², NaN where there is none; 1 where the reading is
#: clipped or stuck and so does not measure rotation; temperature, °C, NaN where unknown
TIME, GYRO, ACCEL, CLIPPED, CELSIUS, WIDTH = 0, slice(1, 4), slice(4, 7), 7, 8, 9
#: columns of places: sequence number; host time, ns since the Unix epoch; SampleFlags
SEQUENCE, HOST_NS, FLAGS = range(3)
#: flags of a reading that does not measure rotation
UNFIT = SampleFlag.CLIPPED | SampleFlag.STUCK
#: initial capacity of a buffer, samples
_ROOM = 256


class Samples(NamedTuple):
    """Decoded samples of one message: rows (n, 9) float64 and places (n, 3) int64.

    rows: device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
    places: sequence number, host time (ns since the Unix epoch), flags.
    sequence: sequence number of the first sample; the device counts its samples from each boot on. n: number of
    samples.
    first_s, last_s: device time of the first and the last sample, s.
    receive_time_ns: host time of receipt at the bridge, ns since the Unix epoch.
    tick_period_s: seconds per tick of the device's clock. clock_rate: host seconds per second of the device's clock.
    ticks (uint64), flags (uint32): packed as on the wire; flags are empty where none is set.
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
        """Convert a decoded SampleBatch into Samples; unknown values become NaN."""
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
        """Temperature at the first sample, °C; None where unknown."""
        return known(self.rows.item(0, CELSIUS))


class SampleBuffer:
    """Buffer of the samples of one boot, numbered in the order of arrival; the first one has the number `first`.

    These numbers are not sequence numbers. Returned arrays are never overwritten.
    """

    def __init__(self, first: int = 0) -> None:
        self._first = first  # number of the sample at index 0 of the arrays
        self._begin = self._end = 0  # indices of the samples held
        self._rows, self._places = np.empty((_ROOM, WIDTH)), np.empty((_ROOM, 3), np.int64)

    @property
    def begin(self) -> int:
        """Number of the first sample still held."""
        return self._first + self._begin

    @property
    def end(self) -> int:
        """Number that the next sample to arrive will get: one more than that of the latest sample."""
        return self._first + self._end

    def put(self, parts: Sequence[tuple[Floats, Wholes]]) -> None:
        """Append samples.

        parts: pairs of rows (n, 9) and places (n, 3), with columns and units as in `Samples`.
        """
        rows, places = zip(*parts, strict=True)
        n = sum(map(len, rows))
        if self._end + n > len(self._rows):
            self._make_room(n)
        begin, self._end = self._end, self._end + n
        np.concatenate(rows, out=self._rows[begin : self._end])
        np.concatenate(places, out=self._places[begin : self._end])

    def rows(self, begin: int, end: int) -> Floats:
        """Rows (n, 9) of the samples numbered `begin` up to but not including `end`; columns and units as in `Samples`."""
        return self._rows[begin - self._first : end - self._first]

    def places(self, begin: int, end: int) -> Wholes:
        """Places (n, 3) of the samples numbered `begin` up to but not including `end`: sequence number, host time (ns), flags."""
        return self._places[begin - self._first : end - self._first]

    def place(self, number: int) -> tuple[int, int]:
        """Sequence number and host time, ns since the Unix epoch, of the sample with this number in the buffer.

        Raises IndexError if the buffer does not hold the sample.
        """
        at = number - self._first
        if not self._begin <= at < self._end:
            raise IndexError(
                f"sample {number} is not in the buffer, which holds samples {self._first + self._begin} to {self.end - 1}"
            )
        return self._places.item(at, SEQUENCE), self._places.item(at, HOST_NS)

    def forget(self, number: int) -> None:
        """Drop the samples numbered below `number` in the buffer."""
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
    """Convert a temperature in °C of a row: NaN, which means unknown, becomes None."""
    return None if isnan(celsius) else celsius
