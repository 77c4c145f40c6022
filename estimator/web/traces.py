"""Traces of one device: raw and corrected rates side by side, thinned to what a chart can show. Pure."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from bridge.wire.messages import CorrectedBatch, Floats, SampleBatch

#: points per second; of denser samples the minimum and maximum of each stretch are kept
POINTS_HZ = 104.0
#: readings without corrected rates are shown alone after this long, s
ALONE_S = 1.0
#: span of points given to a newcomer, s
KEPT_S = 20.0
_WAITING = 400
#: a host clock that goes back by more was reset or is another's; earlier points are then dropped, s
BACK_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """n points: host time (n,) s; raw, corrected and its std (n, 3) rad/s, NaN where there is none."""

    time_s: Floats
    raw: Floats
    corrected: Floats
    std: Floats

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """n samples of one boot, raw and corrected: device and host time (n,) s, rates (n, 3) rad/s.

    bias (3,) rad/s is the reading at zero rate; accel (3,) m/s² is the mean, None without an accelerometer.
    """

    boot: int
    device_s: Floats
    time_s: Floats
    raw: Floats
    corrected: Floats
    std: Floats
    bias: Floats
    bias_std: Floats
    accel: Floats | None


class Traces:
    """Pairs raw with corrected batches of one device by sample number, and thins the pairs to points for a chart."""

    def __init__(self) -> None:
        self._raw: deque[tuple[float, SampleBatch]] = deque(maxlen=_WAITING)
        self._corrected: deque[CorrectedBatch] = deque(maxlen=_WAITING)
        self._latest = 0, -np.inf  # boot and device time
        self._kept: deque[Points] = deque(maxlen=_WAITING)

    def take(self, now: float, raw: list[SampleBatch], corrected: list[CorrectedBatch]) -> list[Pair]:
        """Pair the batches received by monotonic time `now` (s), in order of the readings.

        A raw batch may match several corrected ones; without any after ALONE_S it is returned alone, corrected NaN.
        """
        self._raw += [(now, batch) for batch in raw]
        self._corrected += corrected
        found = []
        while self._raw:
            came, batch = self._raw[0]
            answers = [one for one in self._corrected if one.boot == batch.boot and one.sequence < _end(batch)]
            if now - came < ALONE_S and not any(
                _end(one) >= _end(batch) for one in self._corrected if one.boot == batch.boot
            ):
                break
            self._raw.popleft()
            found.append(_pair(batch, answers))
            while self._corrected and self._corrected[0].boot == batch.boot and _end(self._corrected[0]) <= _end(batch):
                self._corrected.popleft()
        return found

    def points(self, pairs: list[Pair]) -> Points | None:
        """Thin new pairs to points of at most about POINTS_HZ a second, and keep them; None if there are no pairs.

        Pairs that come late in device time are left out.
        """
        pairs = [pair for pair in pairs if not self._late(pair)]
        if not pairs:
            return None
        columns = [
            np.concatenate([getattr(pair, name) for pair in pairs]) for name in ("time_s", "raw", "corrected", "std")
        ]
        time = columns[0]
        found = Points(*_thinned(columns, 2 + 2 * round(max(0.0, time[-1] - time[0]) * POINTS_HZ / 2)))
        if self._kept and time[-1] < self._kept[-1].time_s[-1] - BACK_S:
            self._kept.clear()
        self._kept.append(found)
        while len(self._kept) > 1 and time[-1] - self._kept[0].time_s[0] > KEPT_S:
            self._kept.popleft()
        return found

    def _late(self, pair: Pair) -> bool:
        boot, latest_s = self._latest
        late = pair.boot == boot and 0 <= latest_s - pair.device_s[-1] < KEPT_S
        if not late:
            self._latest = pair.boot, float(pair.device_s[-1])
        return late

    def kept(self) -> Points | None:
        """Return the points of the last KEPT_S seconds, or None."""
        if not self._kept:
            return None
        columns = [np.concatenate([getattr(one, name) for one in self._kept]) for name in Points.__slots__]
        return Points(*columns)


def _end(batch: SampleBatch | CorrectedBatch) -> int:
    return batch.sequence + len(batch)


def _pair(batch: SampleBatch, answers: list[CorrectedBatch]) -> Pair:
    corrected, std = np.full((len(batch), 3), np.nan), np.full((len(batch), 3), np.nan)
    bias, bias_std = np.full(3, np.nan), np.full(3, np.nan)
    for answer in answers:
        begin, end = max(answer.sequence, batch.sequence), min(_end(answer), _end(batch))
        if begin < end:
            to, of = (
                slice(begin - batch.sequence, end - batch.sequence),
                slice(begin - answer.sequence, end - answer.sequence),
            )
            corrected[to], std[to] = answer.rate[of], answer.rate_std[of]
            bias, bias_std = answer.bias.astype(float), answer.bias_std.astype(float)
    accel = None if batch.accel is None else batch.accel.mean(axis=0, dtype=float)
    times = batch.device_time, batch.sample_time_ns / 1e9
    return Pair(batch.boot, *times, batch.gyro.astype(float), corrected, std, bias, bias_std, accel)


def _thinned(columns: list[Floats], points: int) -> list[Floats]:
    """At most `points` points: minimum, then maximum of every column of each stretch; times are unchanged."""
    time, *values = columns
    if len(time) <= points:
        return columns
    edges = np.linspace(0, len(time), points // 2 + 1).astype(int)
    first, last = edges[:-1], edges[1:] - 1
    found: list[Floats] = [np.stack([time[first], time[last]], axis=1).ravel()]
    for column in values:
        least, most = np.fmin.reduceat(column, first), np.fmax.reduceat(column, first)
        found.append(np.stack([least, most], axis=1).reshape(-1, 3))
    return found
