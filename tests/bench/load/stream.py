"""Messages of many devices, as a bridge would send them, ready to be put: a minute of a ward's life over and over."""

from collections.abc import Iterable, Iterator

import numpy as np

from bridge.sim.day import simulate_day
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from bridge.wire.messages import VERSION

WARD, BRIDGE = "load", "bench"
_LIVES, _LIFE_S = 5, 60.0
_TICK_S = 1e-6


def name(number: int) -> str:
    """A device's id."""
    return f"d{number:04d}"


class Fleet:
    """n devices at rate_hz, `batch` samples a message; device i lives the life i mod 5 of the simulator.

    seed: of their boots and ages, which are others each time without one.
    """

    def __init__(self, n: int, rate_hz: float, batch: int, seed: int | None = None) -> None:
        self.n, self.rate_hz, self.batch = n, rate_hz, batch
        self.keys = [keys.build(WARD, "raw", bridge=BRIDGE, device=name(i)) for i in range(n)]
        lives = [simulate_day(seed, _LIFE_S / 3600, rate_hz) for seed in range(_LIVES)]
        self._slots = min(len(life.time_s) for life in lives) // batch
        self._columns = [
            [
                (
                    life.gyro[at : at + batch].astype("<f4").tobytes(),
                    life.accel[at : at + batch].astype("<f4").tobytes(),
                )
                for at in range(0, self._slots * batch, batch)
            ]
            for life in lives
        ]
        rng = np.random.default_rng(seed)
        self._boots = rng.integers(1, 2**63, n).tolist()
        #: no two were switched on at the same moment: their blocks end all the time
        self._ages = rng.uniform(0.0, 1.0, n)

    @property
    def period_s(self) -> float:
        """Between two messages of one device."""
        return self.batch / self.rate_hz

    def round(self, number: int, time_ns: int, which: Iterable[int] | None = None) -> Iterator[tuple[int, bytes]]:
        """The messages of round `number`, of all devices or of some, as if taken and received at time_ns: (device, payload)."""
        sequence = number * self.batch
        taken_s = (sequence + 1 + np.arange(self.batch)) / self.rate_hz
        ticks = np.rint((taken_s + self._ages[:, None]) / _TICK_S).astype("<u8")
        for i in range(self.n) if which is None else which:
            gyro, accel = self._columns[i % _LIVES][number % self._slots]
            yield (
                i,
                columns.SampleBatch(
                    version=VERSION,
                    device=name(i),
                    boot=self._boots[i],
                    sequence=sequence,
                    receive_time_ns=time_ns,
                    start_time_ns=time_ns,
                    tick_period_s=_TICK_S,
                    clock_rate=1.0,
                    ticks=ticks[i].tobytes(),
                    gyro=gyro,
                    accel=accel,
                ).SerializeToString(),
            )
