"""Traces of one device: raw and corrected rates side by side, thinned for a chart. Pure."""

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
class Pair:
    """Raw and corrected rates of n samples of one boot, in the sensor frame.

    device_s, time_s (n,): device time, and host time since the Unix epoch, s. raw, corrected, std (n, 3): readings,
    corrected rates and their standard deviations, rad/s.
    bias, bias_std (3,): reading at zero rate and its standard deviation, rad/s. accel (3,): mean accelerometer reading,
    m/s²; None without an accelerometer.
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
    """Matches raw with corrected batches of one device by sequence number, and thins the pairs to points for a chart."""

    def __init__(self) -> None:
        self._raw: deque[tuple[float, SampleBatch]] = deque(maxlen=_WAITING)
        self._corrected: deque[CorrectedBatch] = deque(maxlen=_WAITING)
        self._latest = 0, -np.inf  # boot and device time
        self._kept: deque[Floats] = deque(maxlen=_WAITING)

    def take(self, now: float, raw: list[SampleBatch], corrected: list[CorrectedBatch]) -> list[Pair]:
        """Pair raw with corrected rates by sequence number; returns the pairs in order of the readings.

        raw, corrected: batches received since the last call. now: monotonic time, s. A raw batch may match several
        corrected batches. Samples that have no corrected rates after ALONE_S seconds get NaN instead.
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

    def points(self, pairs: list[Pair]) -> Floats | None:
        """Thin new pairs to about POINTS_HZ points a second, and keep the points; None if there are none.

        Returns (n, 10): host time, s since the Unix epoch; then x, y, z of raw rate, corrected rate and its standard
        deviation, rad/s, NaN where missing.
        Of denser samples the minimum and maximum of each short stretch are kept. A pair that is 0 to KEPT_S seconds
        behind an earlier pair by device time is left out.
        """
        rows = [np.column_stack([one.time_s, one.raw, one.corrected, one.std]) for one in pairs if not self._late(one)]
        if not rows:
            return None
        found = _thinned(np.concatenate(rows))
        if self._kept and found[-1, 0] < self._kept[-1][-1, 0] - BACK_S:
            self._kept.clear()
        self._kept.append(found)
        while len(self._kept) > 1 and found[-1, 0] - self._kept[0][0, 0] > KEPT_S:
            self._kept.popleft()
        return found

    def _late(self, pair: Pair) -> bool:
        boot, latest_s = self._latest
        late = pair.boot == boot and 0 <= latest_s - pair.device_s[-1] < KEPT_S
        if not late:
            self._latest = pair.boot, float(pair.device_s[-1])
        return late

    def kept(self) -> Floats | None:
        """Return the points (n, 10) of the last KEPT_S seconds, with columns as in `points`; None if there are none."""
        return np.concatenate(self._kept) if self._kept else None


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


def _thinned(rows: Floats) -> Floats:
    """Minimum, then maximum of every column of each stretch, where there are more rows than points; times are unchanged."""
    stretches = 1 + round(max(0.0, rows[-1, 0] - rows[0, 0]) * POINTS_HZ / 2)
    if len(rows) <= 2 * stretches:
        return rows
    edges = np.linspace(0, len(rows), stretches + 1).astype(int)
    least, most = np.fmin.reduceat(rows, edges[:-1]), np.fmax.reduceat(rows, edges[:-1])
    least[:, 0], most[:, 0] = rows[edges[:-1], 0], rows[edges[1:] - 1, 0]
    return np.stack([least, most], axis=1).reshape(-1, rows.shape[1])
