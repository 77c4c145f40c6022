"""Recording of one device: samples at their own times, independent of the file format."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.recording.error import RecordingError
from bridge.recording.plausibility import FASTEST_HZ, SLOWEST_HZ
from bridge.wire.codec import MAX_ACCEL, MAX_RATE
from bridge.wire.messages import Calibration

Floats = NDArray[np.float64]
TICK_S = 1e-6  # tick of a recording's clock, as if the device counted microseconds


class Told(NamedTuple):
    """Device clock, sequence numbers and flags of n samples, as a bridge sent them.

    ticks (n,): count of the device's clock, tick_period_s each. sequence (n,): sample numbers since boot.
    flags (n,): SampleFlag bits.
    """

    ticks: NDArray[np.uint64]
    tick_period_s: float
    sequence: NDArray[np.int64]
    flags: NDArray[np.uint32]


def _vectors(name: str, values: ArrayLike, n: int | None, limit: float, unit: str) -> Floats:
    """Return a copy (n, 3), checked to be finite and within the limit. Raises RecordingError."""
    array = np.array(values, np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or n not in (None, len(array)):
        raise RecordingError(f"{name} has shape {array.shape}; give ({'n' if n is None else n}, 3), one row per sample")
    if len(array) < 2:
        raise RecordingError(f"{name} has {len(array)} sample; at least 2 are needed")
    for said, bad in (("not finite", ~np.isfinite(array)), ("", np.abs(array) > limit)):
        if bad.any():
            at, axis = np.argwhere(bad)[0]
            value = said or f"{array[at, axis]:g} {unit.partition(';')[0]}"
            more = "" if said else f"; up to {limit:g} {unit}"
            raise RecordingError(f"{name} is {value} at sample {at}{more}")
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Samples of one device in SI units, in the sensor frame.

    time_s (n,): s, rising from 0. gyro (n, 3): rad/s. accel (n, 3): specific force, m/s², or None.
    temperature_c (n,), or None.
    rate_hz: output data rate as the file states it, otherwise measured from the times, gaps excluded.
    name: for messages. gyro_range: full-scale range, rad/s; 0 if unknown.
    device: id, empty if unknown. boot: 64-bit boot number, 0 if unknown. model: as the device states it, empty if
    unknown.

    Only for a ward's recording: made: accepted calibrations of this boot, in order of time. begin_ns: host time of the
    first sample, ns since the Unix epoch. told: ticks, sequence numbers and flags as the bridge sent them.
    """

    time_s: Floats
    gyro: Floats
    accel: Floats | None
    temperature_c: Floats | None
    rate_hz: float
    name: str
    gyro_range: float = 0.0
    made: tuple[Calibration, ...] = ()
    begin_ns: int = 0
    told: Told | None = None
    device: str = ""
    boot: int = 0
    model: str = ""
    #: what the reader understood, repaired or doubted, for the user
    notes: tuple[str, ...] = ()

    @classmethod
    def from_arrays(cls, gyro: ArrayLike, accel: ArrayLike | None, rate_hz: float, *, name: str = "arrays") -> Self:
        """Make a recording from arrays sampled at rate_hz, without gaps.

        gyro (n, 3): rad/s. accel (n, 3): specific force, m/s², or None. Both are in the sensor frame, and are copied.
        name: used in messages. Raises RecordingError for a wrong shape or rate, and for values that no IMU can measure.
        """
        if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
            raise RecordingError(
                f"rate_hz is {rate_hz:g}: give the output data rate, {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz"
            )
        rates = _vectors("gyro", gyro, None, MAX_RATE, "rad/s; perhaps the unit is degrees per second")
        n = len(rates)
        force = None if accel is None else _vectors("accel", accel, n, MAX_ACCEL, "m/s²; perhaps the unit is milli-g")
        return cls(np.arange(n) / rate_hz, rates, force, None, rate_hz, name)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def ticks(self) -> NDArray[np.uint64]:
        """Time (n,) of each sample since the first, as a whole number of ticks; a tick is TICK_S (1e-6) s."""
        return np.rint(self.time_s / TICK_S).astype(np.uint64)

    @property
    def device_time(self) -> Floats:
        """Time (n,) of each sample by the device's own clock, s, from that clock's zero; `time_s` if `told` is None.

        With these times the rest detector divides a recording into the same windows as in live processing.
        """
        return self.time_s if self.told is None else np.asarray(self.told.ticks * self.told.tick_period_s, np.float64)

    @property
    def sequence(self) -> NDArray[np.int64]:
        """Sequence number (n,) of each sample, from 0; samples missing at a jump of time are counted."""
        steps = np.diff(self.time_s) * self.rate_hz
        missing = np.where(steps > 1.75, np.rint(steps) - 1, 0)
        return np.arange(len(self)) + np.concatenate([[0], np.cumsum(missing)]).astype(np.int64)
