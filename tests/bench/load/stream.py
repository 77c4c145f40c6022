"""Messages of many devices, as a bridge would send them, ready to be put: a minute of a ward's life over and over.

The devices are worn, and have an accelerometer and a thermometer. None is calibrated: that is not what is measured.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from bridge.wire.messages import VERSION
from tests.sim.day import Day, simulate_day

WARD, BRIDGE = "load", "bench"
#: seeds of one who sits, two who lie, one who walks and one who sleeps, much as a day goes
_LIVES, _LIFE_S = (0, 1, 2, 6, 9), 60.0
#: a life begins with a minute on a table, and some seconds in somebody's hands
_PUT_ON_S = 70.0
_TICK_S = 1e-6


def name(number: int) -> str:
    """A device's id."""
    return f"d{number:04d}"


def lives(rate_hz: float) -> Iterator[Day]:
    """Each from power-up on, until a minute was worn; at the same temperature in its begin and its end, where it goes on."""
    for seed in _LIVES:
        life = simulate_day(seed, (_PUT_ON_S + _LIFE_S) / 3600, rate_hz)
        warmer_c = life.temperature_c[-1] - life.temperature_c[round(_PUT_ON_S * rate_hz)]
        steady_c = life.temperature_c - warmer_c * (life.time_s - _PUT_ON_S) / _LIFE_S
        yield replace(life, temperature_c=steady_c.astype(np.float32))


def listed(n: int) -> str:
    """The [devices] table of a ward of n devices: one bridge has more than are admitted without it."""
    return f"[devices]\nenrolled = [{', '.join(f'{chr(34)}{name(i)}{chr(34)}' for i in range(n))}]\n"


class Fleet:
    """n devices at rate_hz, `batch` samples a message; device i lives the life i mod 5 of those.

    seed: of their boots and ages, which are others each time without one.
    """

    def __init__(self, n: int, rate_hz: float, batch: int, seed: int | None = None) -> None:
        self.n, self.rate_hz, self.batch = n, rate_hz, batch
        self.keys = [keys.build(WARD, "raw", bridge=BRIDGE, device=name(i)) for i in range(n)]
        begin, self._slots = round(_PUT_ON_S * rate_hz), int(_LIFE_S * rate_hz) // batch
        #: of each life, of each message: rates, forces, temperatures
        self._columns = [
            [
                tuple(column[at : at + batch].astype("<f4").tobytes() for column in columns_of_life)
                for at in range(begin, begin + self._slots * batch, batch)
            ]
            for columns_of_life in ((life.gyro, life.accel, life.temperature_c) for life in lives(rate_hz))
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
            gyro, accel, temperature_c = self._columns[i % len(_LIVES)][number % self._slots]
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
                    temperature_c=temperature_c,
                ).SerializeToString(),
            )
