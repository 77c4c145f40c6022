"""What just goes on is let through as the door would sample by sample: the same messages and the same account, to the bit."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from bridge.drivers.driver import Event, Identity, Readings
from bridge.ingest.intake import Intake
from bridge.wire.messages import BootCause, SampleBatch

NOW = 1_700_000_000 * 10**9
RATE_HZ = 104.0
EVENTS = 1500
USUAL = 0.9  # of all events


class Strict(Intake):
    """Looks at every sample."""

    def _plain(self, readings: Readings, identity: Identity) -> SampleBatch | None:
        return None


class Easy(Intake):
    """Counts the readings that were plain."""

    plain = 0

    def _plain(self, readings: Readings, identity: Identity) -> SampleBatch | None:
        batch = super()._plain(readings, identity)
        self.plain += batch is not None
        return batch


class Life:
    """A device that mostly goes on, and of everything that happens to devices now and then has some."""

    def __init__(self, seed: int, *, bits: int, gyro_range: float, noise: float, step: float, precision: str) -> None:
        self.rng = np.random.default_rng(seed)
        self.noise, self.step, self.precision, self.bits = noise, step, precision, bits
        self.identity = Identity(
            boot=7, boot_cause=BootCause.POWER_UP, model="m", firmware="f", rate_hz=RATE_HZ, gyro_range=gyro_range,
            tick_period_s=1e-6, has_accel=True, has_temperature=True, tick_bits=bits, sequence_bits=16,
        )  # fmt: skip
        self.sequence, self.time_s, self.host_s, self.celsius = 2**16 - 400, 2.0 ** min(bits, 40) * 1e-6 - 3, 0.0, 30.0

    def events(self) -> list[Event]:
        return [self.identity, *(event for _ in range(EVENTS) for event in self._next())]

    def _next(self) -> list[Event]:
        rng = self.rng
        n = int(rng.integers(1, 12))
        what = "usual" if rng.random() < USUAL else str(rng.choice(list(HAPPENS)))
        return HAPPENS[what](self, self._sent(n))

    def _sent(self, n: int) -> Readings:
        rng = self.rng
        time_s = self.time_s + (1 + np.arange(n)) / RATE_HZ
        ticks = np.rint(time_s * 1e6).astype(np.int64) % 2 ** min(self.bits, 62)
        self.time_s = float(time_s[-1])
        self.host_s = max(self.host_s, self.time_s * 1.0003 + rng.exponential(0.004))
        gyro = np.round(rng.normal(0, self.noise, (n, 3)) / self.step) * self.step
        sequence, self.sequence = self.sequence, self.sequence + n
        return Readings(
            boot=self.identity.boot,
            sequence=sequence % 2**16,
            receive_time_ns=NOW + round(self.host_s * 1e9),
            ticks=ticks.astype(np.uint64 if self.bits > 32 else np.uint32),
            gyro=gyro.astype(self.precision),
            accel=rng.normal(0, 5, (n, 3)).astype(self.precision),
            temperature_c=np.full(n, self.celsius).astype(self.precision),
        )  # fmt: skip

    def lost(self, readings: Readings) -> list[Event]:
        self.time_s += 0.1
        self.sequence += 10
        return [readings]

    def late(self, readings: Readings) -> list[Event]:
        self.host_s += 3.0
        return [readings]

    def reboots(self, readings: Readings) -> list[Event]:
        self.identity = replace(self.identity, boot=int(self.rng.integers(2**63)))
        self.sequence, self.time_s, self.host_s = 0, 0.0, self.host_s + 5.0
        return [readings, self.identity]

    def warms(self, readings: Readings) -> list[Event]:
        self.celsius = float(self.rng.uniform(20, 40))
        return [readings]

    def sticks(self, readings: Readings) -> list[Event]:
        gyro = np.repeat(readings.gyro[:1], 40, axis=0)
        parts = [self._sent(8) for _ in range(5)]
        return [readings, *(replace(part, gyro=gyro[:8]) for part in parts)]

    def renamed(self, readings: Readings) -> list[Event]:
        self.identity = replace(self.identity, gyro_range=float(self.rng.choice([0.0, 4.36, 35.0])))
        return [self.identity, readings]

    def loses_time(self, readings: Readings) -> list[Event]:
        self.identity = replace(self.identity, has_clock=not self.identity.has_clock)
        return [self.identity, readings]

    def with_gyro(self, readings: Readings, value: float) -> list[Event]:
        gyro = readings.gyro.copy()
        gyro[self.rng.integers(len(gyro)), self.rng.integers(3)] = value
        return [replace(readings, gyro=gyro)]


HAPPENS: dict[str, Callable[[Life, Readings], list[Event]]] = {
    "usual": lambda _, readings: [readings],
    "lost": Life.lost,
    "late": Life.late,
    "reboots": Life.reboots,
    "warms": Life.warms,
    "sticks": Life.sticks,
    "renamed": Life.renamed,
    "loses_time": Life.loses_time,
    "overtaken": lambda life, readings: [life._sent(2), readings],
    "twice": lambda _, readings: [readings, readings],
    "old": lambda _, readings: [replace(readings, boot=1)],
    "numbered_anew": lambda _, readings: [replace(readings, ticks=readings.ticks[::-1])],
    "clips": lambda life, readings: life.with_gyro(readings, 4.33),
    "clips_almost": lambda life, readings: life.with_gyro(readings, 0.99 * 4.36),
    "beyond": lambda life, readings: life.with_gyro(readings, 1000.0),
    "far_beyond": lambda life, readings: life.with_gyro(readings, 1e30),
    "nan": lambda life, readings: life.with_gyro(readings, np.nan),
    "ragged": lambda _, readings: [replace(readings, gyro=readings.gyro[1:])],
    "jolted": lambda _, readings: [replace(readings, accel=readings.gyro + 1e5)],
    "no_accel": lambda _, readings: [replace(readings, accel=None)],
    "no_temperature": lambda _, readings: [replace(readings, temperature_c=None)],
    "odd_temperature": lambda _, readings: [replace(readings, temperature_c=readings.gyro[:, 0] * np.nan)],
    "warmer_by_about_two": lambda _, readings: [replace(readings, temperature_c=readings.gyro[:, 0] + 32)],
}


@pytest.mark.parametrize(
    ("bits", "gyro_range", "noise", "step", "precision"),
    [
        (32, 4.36, 0.001, 1e-6, "float32"),  # a fine sensor
        (24, 4.36, 0.002, 0.001, "float64"),  # one that repeats itself now and then
        (32, 0.0, 0.5, 0.01, "float32"),  # of unknown range
        (61, 35.0, 0.5, 0.001, "float64"),
        (64, 4.36, 0.01, 0.001, "float32"),
        (32, 4.36, 0.001, 0.004, "float32"),  # always the same
    ],
)
def test_plain_readings_become_what_they_would(
    bits: int, gyro_range: float, noise: float, step: float, precision: str
) -> None:
    life = Life(bits, bits=bits, gyro_range=gyro_range, noise=noise, step=step, precision=precision)
    easy, strict = Easy("d", "b", "native", "x"), Strict("d", "b", "native", "x")
    for event in life.events():
        for ours, theirs in zip(easy.take(event), strict.take(event), strict=True):
            for field in fields(SampleBatch):
                _same(getattr(ours, field.name), getattr(theirs, field.name))
        assert repr(easy.info(0, {})) == repr(strict.info(0, {}))
    assert easy.plain > EVENTS // 4
    assert strict.events.total() > EVENTS // 50


def _same(ours: object, theirs: object) -> None:
    if isinstance(theirs, np.ndarray):
        assert isinstance(ours, np.ndarray)
        assert (ours.dtype, ours.shape, ours.tobytes()) == (theirs.dtype, theirs.shape, theirs.tobytes())
    else:
        assert ours == theirs
