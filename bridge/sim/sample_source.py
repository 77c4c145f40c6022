"""Sample sources of a virtual device: the contract, and a simulated sensor on a moving body.

Sample times are on the device's own clock.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, Truth, draw
from bridge.sim.quaternion import Array
from bridge.sim.ward_script import Life

_BLOCK_S = 1.0
_TICKS_PER_S = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class TrueSamples:
    """True values of n samples: angular rate, attitude and bias.

    rate (n, 3): rad/s, sensor axes. attitude (n, 4): unit quaternions wxyz, sensor to earth. bias (n, 3): rad/s.
    """

    rate: Array
    attitude: Array
    bias: Array

    def __getitem__(self, part: slice) -> "TrueSamples":
        """Truth of a slice of the samples."""
        return TrueSamples(self.rate[part], self.attitude[part], self.bias[part])


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Readings of n samples, in sensor axes, with their true values.

    clock_s (n,): time by the device's clock since streaming began, s. gyro (n, 3): rad/s. accel (n, 3): m/s².
    temperature_c (n,). truth: true values; None if unknown.
    """

    clock_s: Array
    gyro: Array
    accel: Array
    temperature_c: Array
    truth: TrueSamples | None = None

    def __len__(self) -> int:
        return len(self.clock_s)

    def __getitem__(self, part: slice) -> "Samples":
        """A slice of the samples."""
        truth = None if self.truth is None else self.truth[part]
        return Samples(self.clock_s[part], self.gyro[part], self.accel[part], self.temperature_c[part], truth)

    def joined(self, later: "Samples") -> "Samples":
        """Return these samples followed by those of `later`; the result has no true values."""
        return Samples(
            clock_s=np.concatenate([self.clock_s, later.clock_s]),
            gyro=np.concatenate([self.gyro, later.gyro]),
            accel=np.concatenate([self.accel, later.accel]),
            temperature_c=np.concatenate([self.temperature_c, later.temperature_c]),
        )


@dataclass(frozen=True, slots=True)
class Sensor:
    """Sensor properties that a device reports.

    rate_hz: nominal output data rate. gyro_range: full-scale range, rad/s.
    has_accel, has_temperature: True if the device measures acceleration or temperature.
    """

    rate_hz: float
    gyro_range: float
    has_accel: bool = True
    has_temperature: bool = True


class Source(Protocol):
    """Source of a virtual device's samples, in order from power-up on.

    sensor: properties that the device reports.
    """

    sensor: Sensor

    def power_up(self, rng: np.random.Generator, true_s_per_clock_s: float) -> Truth | None:
        """Start a boot with random values from rng; return the true parameters of the sensor, or None if unknown.

        true_s_per_clock_s: true seconds per second of the device's clock.
        """

    def pace(self, rate_hz: float) -> None:
        """Set the output data rate, Hz, from the next read until the next power-up.

        A source without this ability ignores the call. Afterwards `sensor` has the actual rate.
        """

    def read(self) -> Samples | None:
        """Return the samples that follow those of the last call since power-up; None after the source's last sample.

        One call returns about one second of the device's clock.
        """


class SimulatedSource:
    """Endless source of samples from a simulated moving body and a simulated sensor with errors.

    script: makes the motion of a boot from a random generator. spec: error limits of the sensor; None for ImuSpec().
    rate_hz: output data rate.
    """

    def __init__(
        self, script: Callable[[np.random.Generator], Life], spec: ImuSpec | None = None, rate_hz: float = 104.0
    ) -> None:
        self.spec = spec or ImuSpec()
        self.sensor = Sensor(rate_hz, float(np.radians(self.spec.range_dps)))
        self._script = script
        self._usual = self.sensor
        self._part: Truth | None = None

    def power_up(self, rng: np.random.Generator, true_s_per_clock_s: float) -> Truth:
        """Start a boot: draw motion and sensor errors from rng, and return the true parameters of the sensor.

        true_s_per_clock_s: true seconds per second of the device's clock. Errors that belong to the part are drawn at
        the first boot only.
        """
        self.sensor = self._usual
        self._motion = self._script(rng)
        drawn = draw(self.spec, rng)
        self._imperfection = ImuErrorModel(self.spec, rng, drawn.of_part(self._part) if self._part else drawn)
        self._part = self._imperfection.truth
        self._true_s_per_clock_s = true_s_per_clock_s
        self._ticks, self._sent = 0.0, 0  # ticks at which this rate began, and samples since then
        return self._imperfection.truth

    def pace(self, rate_hz: float) -> None:
        """Set the output data rate, Hz, from the next read until the next power-up."""
        self._ticks, self._sent = self._ticks + self._sent * (_TICKS_PER_S / self.sensor.rate_hz), 0
        self.sensor = replace(self.sensor, rate_hz=rate_hz)
        self._imperfection.pace(rate_hz / self._usual.rate_hz)

    def read(self) -> Samples:
        """Return the samples that follow those of the last call since power-up, with their true values.

        One call returns one second of the device's clock.
        """
        block = max(1, round(self.sensor.rate_hz * _BLOCK_S))
        number = np.arange(self._sent + 1, self._sent + block + 1)
        self._sent += block
        # On whole ticks, so that the clock's resolution adds no error.
        clock_s: Array = np.asarray(
            np.round(self._ticks + number * (_TICKS_PER_S / self.sensor.rate_hz)) / _TICKS_PER_S
        )
        motion = self._motion.advance(clock_s * self._true_s_per_clock_s)
        readings = self._imperfection.read(motion)
        truth = TrueSamples(motion.rate, motion.attitude, readings.bias)
        return Samples(clock_s, readings.gyro, readings.accel, readings.temperature_c, truth)
