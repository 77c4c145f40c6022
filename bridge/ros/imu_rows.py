"""Combines readings, corrected rates and orientations of the same samples into one row per sample. No I/O.

A batch of corrected rates waits for the accelerations and orientations of its samples, at most WAIT_S (0.5) seconds.
"""

from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import CorrectedBatch, OrientationBatch, SampleBatch

Floats = NDArray[np.float64]
#: longest wait of a corrected batch for messages about the same samples, s
WAIT_S = 0.5
#: an impatient join waits for a kind of message only if the device sent one in this time before, s
SILENT_S = 3.0
#: time for which acceleration and orientation are kept, s
_KEPT_S = 5.0

Said = SampleBatch | CorrectedBatch | OrientationBatch


class ImuRows(NamedTuple):
    """Consecutive samples of one boot of a device, one row per sample. NaN marks values that a sample lacks.

    boot: boot number. sequence: sequence number of the first sample. time_ns (n,): host time, ns since the Unix epoch.
    rate (n, 3): angular rate, rad/s, sensor frame; rate_var (n, 3): its variance, (rad/s)², None if unknown.
    accel (n, 3): specific force, m/s², sensor frame. quat_wxyz (n, 4): rotation from sensor to earth, scalar first.
    attitude_cov (3, 3): covariance of the orientation, rad², about earth axes; zero if unknown.
    """

    device: str
    boot: int
    sequence: int
    time_ns: NDArray[np.int64]
    rate: Floats
    rate_var: Floats | None
    accel: Floats
    quat_wxyz: Floats
    attitude_cov: Floats


def reading_rows(batch: SampleBatch) -> ImuRows:
    """Return the readings of a batch as rows: uncorrected rates in rad/s, without variance and orientation."""
    n = len(batch)
    accel = np.full((n, 3), np.nan) if batch.accel is None else batch.accel.astype(float)
    unknown = np.full((n, 4), np.nan)
    times, rate = batch.sample_time_ns, batch.gyro.astype(float)
    return ImuRows(batch.device, batch.boot, batch.sequence, times, rate, None, accel, unknown, np.zeros((3, 3)))


@dataclass(slots=True)
class _Heard:
    """Recent messages of one kind about one device."""

    recent: deque[tuple[float, SampleBatch | OrientationBatch]] = field(default_factory=deque)

    def add(self, batch: SampleBatch | OrientationBatch, now_s: float) -> None:
        self.recent.append((now_s, batch))
        while self.recent[0][0] < now_s - _KEPT_S:
            self.recent.popleft()

    def awaited(self, batch: CorrectedBatch, now_s: float, *, patient: bool) -> bool:
        """Return whether a message about the last sample of the batch may still come."""
        if not self.recent or now_s - self.recent[-1][0] > SILENT_S:
            return patient
        last = self.recent[-1][1]
        return last.boot != batch.boot or last.sequence + len(last) < batch.sequence + len(batch)

    def rows(self, batch: CorrectedBatch) -> Iterator[tuple[SampleBatch | OrientationBatch, slice, slice]]:
        """Yield the messages about samples of the batch, with their rows in the batch and in themselves."""
        for _, one in self.recent:
            first, end = max(one.sequence, batch.sequence), min(one.sequence + len(one), batch.sequence + len(batch))
            if one.boot == batch.boot and first < end:
                yield (
                    one,
                    slice(first - batch.sequence, end - batch.sequence),
                    slice(first - one.sequence, end - one.sequence),
                )


@dataclass(slots=True)
class _Device:
    readings: _Heard = field(default_factory=_Heard)
    attitudes: _Heard = field(default_factory=_Heard)
    waiting: deque[tuple[float, CorrectedBatch]] = field(default_factory=deque)

    def over(self, now_s: float) -> bool:
        """Return whether nothing waits, and nothing came for long."""
        return not self.waiting and all(
            not one.recent or one.recent[-1][0] < now_s - _KEPT_S for one in (self.readings, self.attitudes)
        )


class ImuJoin:
    """Joins readings, corrected rates and orientations of any number of devices into ImuRows.

    Samples are matched by boot and sequence number.
    Add the corrected rates of a device in order, each batch once; readings and orientations may be repeated.
    patient: True waits for readings and orientations even if none of the device has been added yet. Use it if messages
    may arrive late, such as history from caches.
    """

    def __init__(self, *, patient: bool = False) -> None:
        self._devices: defaultdict[str, _Device] = defaultdict(_Device)
        self._patient = patient

    def take(self, said: Said, now_s: float) -> list[ImuRows]:
        """Add a message; return the rows of its device that are complete or have waited WAIT_S (0.5) seconds.

        said: readings, corrected rates or orientations. now_s: seconds of a monotonic clock.
        Each result has the samples of one batch of corrected rates.
        """
        device = self._devices[said.device]
        if isinstance(said, CorrectedBatch):
            device.waiting.append((now_s + WAIT_S, said))
        else:
            (device.readings if isinstance(said, SampleBatch) else device.attitudes).add(said, now_s)
        return list(self._ready(device, now_s))

    def due(self, now_s: float = inf) -> list[ImuRows]:
        """Return the rows of all devices that are complete or have waited WAIT_S (0.5) seconds.

        now_s: seconds of a monotonic clock; by default, all waiting rows are returned.
        """
        found = [rows for device in self._devices.values() for rows in self._ready(device, now_s)]
        for name in [name for name, device in self._devices.items() if device.over(now_s)]:
            del self._devices[name]
        return found

    def _ready(self, device: _Device, now_s: float) -> Iterator[ImuRows]:
        others = device.readings, device.attitudes
        while device.waiting:
            due_s, batch = device.waiting[0]
            if now_s < due_s and any(one.awaited(batch, now_s, patient=self._patient) for one in others):
                return
            device.waiting.popleft()
            yield _joined(batch, device)


def _joined(batch: CorrectedBatch, device: _Device) -> ImuRows:
    n = len(batch)
    accel, quat_wxyz, attitude_cov = np.full((n, 3), np.nan), np.full((n, 4), np.nan), np.zeros((3, 3))
    for one, here, there in device.readings.rows(batch):
        if isinstance(one, SampleBatch) and one.accel is not None:
            accel[here] = one.accel[there]
    for one, here, there in device.attitudes.rows(batch):
        if isinstance(one, OrientationBatch):
            quat_wxyz[here], attitude_cov = one.quat_wxyz[there], one.covariance.astype(float)
    rate, rate_var = batch.rate.astype(float), batch.rate_std**2
    times = batch.sample_time_ns
    return ImuRows(batch.device, batch.boot, batch.sequence, times, rate, rate_var, accel, quat_wxyz, attitude_cov)
