"""Builds identities and readings from single samples of a device that numbers neither boots nor samples."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bridge.drivers.boot_detection import BootDetector, Time, draw_boot
from bridge.drivers.driver import Event, Identity, Readings
from bridge.wire.refusal import Tally

Vector = tuple[float, float, float]
ODD_TIME, RATE_CHANGED, STANDS_STILL = "odd_time", "rate_changed", "clock_stands_still"
_STEPS = 32  # tick steps between samples before a measured rate is used
_MOST_HELD = 1024  # samples held until the rate is known; by then a working clock has moved
_CHANGED = 0.15  # relative change of the rate that counts as a new rate
_MISSING = 1.75  # periods; a longer step means a missing sample
_NOMINAL = 0.01  # relative; oscillator errors are smaller
_MAX_BATCH = 256
_LARGEST = 1 << 64


@dataclass(frozen=True, slots=True)
class DeviceDescription:
    """Properties of a device that its samples do not contain.

    gyro_range: full-scale range in rad/s, 0 if unknown.
    rate_hz: sample rate, Hz; 0 if it is to be measured by the device's clock. guessed_rate_hz: rate, Hz, used instead
    if the device has no clock, or if the stream ends before a rate is measured.
    divided_hz: base rate, Hz: the device's possible rates are divided_hz / n, n whole; 0 if unknown. A measured rate
    within 1 % of one of them is reported as exactly that rate. Without this, the measured rate would differ between
    boots. A stored calibration, which is looked up by sample rate, would then not be found.
    """

    model: str
    firmware: str = ""
    gyro_range: float = 0.0
    rate_hz: float = 0.0
    guessed_rate_hz: float = 100.0
    divided_hz: float = 0.0


class _Sample(NamedTuple):
    tick: int
    gyro: Vector
    accel: Vector | None
    temperature_c: float | None
    receive_time_ns: int
    missing: int  # samples missing before this one, for devices without a clock
    clipped: bool

    @property
    def columns(self) -> tuple[bool, bool]:
        return self.accel is not None, self.temperature_c is not None


class SampleAssembler:
    """Collects single samples into identities and readings, for devices that number neither boots nor samples.

    faults: number of dropped samples by label. about: description of the device; it may be replaced at any time, and
    the identity is then sent again. boot: boot number of the latest sample, 0 before the first.
    tick_period_s: seconds per tick of the device's clock; None without a clock. The clock wraps at 2**tick_bits ticks.
    draw: returns a new boot number.
    With a clock, a missing sample is detected and uses up a sequence number; without a clock it stays undetected.
    Samples are held until the sample rate is known.
    """

    def __init__(
        self,
        faults: Tally,
        about: DeviceDescription,
        tick_period_s: float | None,
        tick_bits: int = 64,
        draw: Callable[[], int] = draw_boot,
    ) -> None:
        self.faults = faults
        self.about = about
        self._period_s = tick_period_s
        self._boots = BootDetector(tick_period_s, tick_bits, draw)
        self._events: list[Event] = []
        self._rate_hz = 0.0
        self._begin()

    def opened(self) -> None:
        """Report that the port was opened (again): the next sample may belong to another boot."""
        self._boots.opened()

    def rebooted(self) -> None:
        """Report that the device announced a boot: the next sample begins it."""
        self._boots.said()

    def paced(self, rate_hz: float) -> None:
        """Set a new sample rate in Hz, which the device uses from the next sample on.

        Ignored while the previous rate is unknown.
        """
        if self._rate_hz:
            self._flush()
            self._rate_hz = rate_hz
            self._steps.clear()

    def add(
        self,
        tick: int,
        gyro: Vector,
        accel: Vector | None = None,
        temperature_c: float | None = None,
        *,
        receive_time_ns: int,
        missing: int = 0,
        clipped: bool = False,
    ) -> None:
        """Add one sample as the device sent it; `events` returns it later as part of readings.

        tick: device time in ticks (ignored without a clock). gyro: (x, y, z), rad/s. accel: (x, y, z), m/s².
        temperature_c: °C.
        receive_time_ns: receive time, ns since the Unix epoch.
        missing: number of samples known to be lost before this one; 0 for a device with a clock, whose ticks show the
        loss.
        clipped: True if the device reports this sample as clipped.
        """
        placed = self._boots.observe(tick, receive_time_ns)
        if placed is Time.ODD:
            self.faults.add(ODD_TIME)
            return
        if placed is Time.BEGINS:
            self._finish()
            self._begin()
        sample = _Sample(self._boots.tick, gyro, accel, temperature_c, receive_time_ns, missing, clipped)
        if self._period_s is not None:
            self._measure(sample.tick)
        self._held.append(sample)
        if self._rate_hz:
            self._number_held()
        elif len(self._held) >= _MOST_HELD:
            self.faults.add(STANDS_STILL, len(self._held))
            self._held.clear()
            self._steps.clear()

    def events(self) -> list[Event]:
        """Return the identities and readings completed since the last call."""
        self._flush()
        events, self._events = self._events, []
        return events

    def finish(self) -> list[Event]:
        """End the stream: return the remaining events. If no sample rate was measured, guessed_rate_hz is used."""
        self._finish()
        return self.events()

    def _begin(self) -> None:
        """Reset the state that belongs to one boot."""
        self.boot, self._cause = self._boots.number, self._boots.cause
        self._last_tick: int | None = None
        self._steps: list[int] = []
        self._held: list[_Sample] = []
        self._run: list[_Sample] = []  # numbered samples without a gap
        self._run_end = 0  # the sequence number after the last of _run
        self._sequence = 0  # sequence number of the next sample
        self._numbered_tick = 0  # tick of the sample before it
        self._told: Identity | None = None
        self._rate_hz = self.about.rate_hz
        if self._period_s is None and not self._rate_hz:
            self._rate_hz = self.about.guessed_rate_hz

    def _finish(self) -> None:
        """Emit the remaining samples of a boot, with the guessed rate if none is known."""
        if not self._rate_hz:
            self._rate_hz = self.about.guessed_rate_hz
        self._number_held()
        self._flush()

    def _measure(self, tick: int) -> None:
        """Measure the rate by the median tick step, and follow a device that changes its rate."""
        if self._last_tick is not None and tick > self._last_tick:
            self._steps.append(tick - self._last_tick)
        self._last_tick = tick
        if len(self._steps) < _STEPS:
            return
        low, step, high = np.percentile(self._steps, (25, 50, 75)) * (self._period_s or 1.0)
        self._steps.clear()
        if not self._rate_hz:
            self._rate_hz = self._nominal(float(1 / step))
        elif low * self._rate_hz > 1 + _CHANGED or high * self._rate_hz < 1 - _CHANGED:
            self.faults.add(RATE_CHANGED)
            self._flush()
            self._rate_hz = self._nominal(float(1 / step))

    def _nominal(self, rate_hz: float) -> float:
        divisor = max(1, round(self.about.divided_hz / rate_hz))
        nominal = self.about.divided_hz / divisor
        return nominal if abs(nominal / rate_hz - 1) < _NOMINAL else rate_hz

    def _number_held(self) -> None:
        for sample in self._held:
            number = self._sequence + self._missing_before(sample)
            if number < 0:
                self.faults.add(ODD_TIME)  # older than the first sample of the boot
                continue
            run = self._run
            if run and (number != self._run_end or len(run) == _MAX_BATCH or sample.columns != run[-1].columns):
                self._flush()
            self._run.append(sample)
            self._run_end = number + 1
            if number >= self._sequence:
                self._sequence, self._numbered_tick = number + 1, sample.tick
        self._held = []

    def _missing_before(self, sample: _Sample) -> int:
        """Number of samples missing before this one; negative for an overtaken sample, which gets the number it missed."""
        if self._sequence == 0:
            return 0
        if self._period_s is None:
            return sample.missing
        periods = (sample.tick - self._numbered_tick) * self._period_s * self._rate_hz
        return round(periods) - 1 if periods > _MISSING or periods <= 0 else 0

    def _flush(self) -> None:
        run, self._run = self._run, []
        if not run:
            return
        has_accel, has_temperature = run[0].columns
        self._introduce(has_accel=has_accel, has_temperature=has_temperature)
        first = self._run_end - len(run)
        ticks = range(first, self._run_end) if self._period_s is None else [sample.tick for sample in run]
        self._events.append(
            Readings(
                boot=self.boot,
                sequence=first,
                receive_time_ns=run[-1].receive_time_ns,
                ticks=np.array([tick % _LARGEST for tick in ticks], np.uint64),
                gyro=np.array([sample.gyro for sample in run], np.float64),
                accel=np.array([sample.accel for sample in run], np.float64) if has_accel else None,
                temperature_c=np.array([s.temperature_c for s in run], np.float64) if has_temperature else None,
                clipped=np.array([s.clipped for s in run]) if any(s.clipped for s in run) else None,
            )
        )

    def _introduce(self, *, has_accel: bool, has_temperature: bool) -> None:
        """Emit the identity at a boot, and whenever it differs from the one last announced."""
        identity = Identity(
            boot=self.boot,
            boot_cause=self._cause,
            model=self.about.model,
            firmware=self.about.firmware,
            rate_hz=self._rate_hz,
            gyro_range=self.about.gyro_range,
            tick_period_s=self._period_s or 1 / self._rate_hz,
            has_accel=has_accel,
            has_temperature=has_temperature,
            tick_bits=64,
            sequence_bits=64,
            has_clock=self._period_s is not None,
        )
        if identity != self._told:
            self._told = identity
            self._events.append(identity)
