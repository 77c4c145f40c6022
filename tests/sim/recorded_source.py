"""A recording as the source of a virtual device's samples."""

import numpy as np
from numpy.typing import ArrayLike

from bridge.sim.sample_source import Samples, Sensor

_BLOCK_S = 1.0


class RecordedSource:
    """A recording, played once each boot.

    gyro (n, 3) rad/s, accel (n, 3) m/s² or None, temperature_c (n,) or None.
    time_s (n,), rising, where the samples are not at a fixed rate; only differences count.
    """

    def __init__(
        self,
        gyro: ArrayLike,
        accel: ArrayLike | None = None,
        temperature_c: ArrayLike | None = None,
        *,
        rate_hz: float,
        time_s: ArrayLike | None = None,
        gyro_range_dps: float = 2000.0,
    ) -> None:
        gyro = np.asarray(gyro, dtype=np.float64)
        n = len(gyro)
        self.sensor = Sensor(rate_hz, float(np.radians(gyro_range_dps)), accel is not None, temperature_c is not None)
        time = np.arange(n) / rate_hz if time_s is None else np.asarray(time_s, dtype=np.float64)
        self._samples = Samples(
            clock_s=time - time[:1] + 1 / rate_hz,
            gyro=gyro,
            accel=np.zeros((n, 3)) if accel is None else np.asarray(accel, dtype=np.float64),
            temperature_c=np.zeros(n) if temperature_c is None else np.asarray(temperature_c, dtype=np.float64),
        )
        self._block = max(1, round(rate_hz * _BLOCK_S))

    def power_up(self, rng: np.random.Generator, true_s_per_clock_s: float) -> None:
        """See Source: from the beginning, the same at every boot."""
        self._sent = 0

    def pace(self, rate_hz: float) -> None:
        """See Source: it has none but its own."""

    def read(self) -> Samples | None:
        """See Source."""
        block = self._samples[self._sent : self._sent + self._block]
        self._sent += len(block)
        return block if len(block) else None
