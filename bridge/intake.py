"""The door of one device: events in, valid batches out, and an account of everything that did not come through.

Pure: no clock, no thread. At any moment samples_in = samples published + the sum of dropped, since the boot began.
"""

import math

import numpy as np
from numpy.typing import NDArray

from bridge.clock import ClockFit
from bridge.drivers.driver import Battery, Event, Identity, Notice, Readings
from bridge.unwrap import Counters, Counts
from bridge.wire.checks import MAX_TEXTS
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE, MAX_SAMPLES
from bridge.wire.messages import BootCause, DeviceInfo, SampleBatch, SampleFlag
from bridge.wire.refusal import Reason, Tally

BEFORE_IDENTITY = "before_identity"
CLIPPED_AT = 0.99  # of full scale
PLAUSIBLE = 2.0  # times full scale: common mistakes of sensitivity reach 1.17
_RATE_WINDOW_S = 10.0
_NO_TEMPERATURE = "temperature_missing"
_ODD = 0x9E3779B97F4A7C15  # makes boot numbers that nobody else draws
_INSTEAD_OF_0 = 1  # boot 0 is for devices that are not heard
_MAX_COUNT = 2**62
_NOBODY = Identity(
    boot=0,
    boot_cause=BootCause.UNKNOWN,
    model="",
    firmware="",
    rate_hz=0.0,
    gyro_range=0.0,
    tick_period_s=0.0,
    has_accel=False,
    has_temperature=False,
)

Bools = NDArray[np.bool_]


class Intake:
    """One device: `take` events in the order they came; `info` is the account."""

    def __init__(self, device: str, bridge: str, driver: str, place: str) -> None:
        self.events = Tally()  # reboots, gaps, missing samples, reconnections: over the life of the bridge
        self.driver = driver
        self._names = (device, bridge, driver, place)
        self._identity: Identity | None = None
        self._unsaid = 0  # reboots since the identity's that the device did not tell
        self._battery = Battery(math.nan)
        self._notices: dict[str, str] = {}
        self._begin()

    def _begin(self) -> None:
        """What is of one boot only."""
        self.clock = ClockFit()
        self.samples_in = 0
        self.samples = 0
        self.dropped = Tally()
        self._counters = Counters()
        self._old = 0  # samples in a row that were no news
        self._next: int | None = None  # the sequence that would go on without a hole
        self._rate_from: tuple[int, float] | None = None  # sequence and device time, some seconds ago
        self._measured_rate_hz = 0.0

    @property
    def boot(self) -> int | None:
        """The boot as it is published, never 0; None before the device said any."""
        if self._identity is None:
            return None
        return (self._identity.boot + self._unsaid * _ODD) % 2**64 or _INSTEAD_OF_0

    @property
    def has_clock(self) -> bool:
        """Whether the device is known to tell time; if not, when each reading came in is all there is."""
        return self._identity is not None and self._identity.has_clock

    def take(self, event: Event) -> list[SampleBatch]:
        """What may be published of an event, in order."""
        if isinstance(event, Identity):
            self._greet(event)
        elif isinstance(event, Readings):
            return self._read(event)
        elif isinstance(event, Battery):
            self._battery = event
        else:
            self._note(event)
        return []

    def overflowed(self, batch: SampleBatch) -> None:
        """A batch that was let through could not be kept until it was published."""
        if batch.boot == self.boot:
            self.samples -= len(batch)
            self.dropped.add(Reason.OVERFLOW, len(batch))
        self.events.add("overflows")

    def info(self, time_ns: int, faults: dict[str, int], trouble: str = "") -> DeviceInfo:
        """What is known of the device at time_ns; boot 0 before it said who it is. Its driver's faults become events."""
        identity = self._identity or _NOBODY
        device, bridge, driver, place = self._names
        if self._identity is None and not trouble:
            trouble = f"{place}: nothing was heard of it yet"
        return DeviceInfo(
            device=device,
            bridge=bridge,
            boot=self.boot or 0,
            boot_cause=identity.boot_cause,
            model=identity.model,
            firmware=identity.firmware,
            driver=driver,
            port=place,
            rate_hz=identity.rate_hz,
            measured_rate_hz=self._measured_rate_hz,
            gyro_range=identity.gyro_range,
            has_accel=identity.has_accel,
            has_temperature=identity.has_temperature,
            time_ns=time_ns,
            samples=self.samples,
            dropped=self.dropped.as_dict(),
            events={**self.events.as_dict(), **faults},
            trouble=trouble,
            battery_percent=self._battery.percent,
            charging=self._battery.charging,
            notices=dict(self._notices),
            has_clock=identity.has_clock,
        )

    def _note(self, notice: Notice) -> None:
        """Keep the latest of each name, and no more names than the wire takes."""
        self._notices.pop(notice.name, None)
        if notice.text:
            self._notices[notice.name] = notice.text
        while len(self._notices) > MAX_TEXTS:
            self._notices.pop(next(iter(self._notices)))

    def _greet(self, identity: Identity) -> None:
        if self._identity is None or identity.boot != self._identity.boot:
            self._unsaid = 0
            if self._identity is not None:
                self.events.add("reopened" if identity.boot_cause is BootCause.PORT_OPENED else "reboots")
                self._begin()
            elif self.samples_in:
                self.events.add(BEFORE_IDENTITY, self.samples_in)
                self._begin()
        elif identity.rate_hz != self._identity.rate_hz:
            self._rate_from = None
        self._identity = identity

    def _read(self, readings: Readings) -> list[SampleBatch]:
        n = len(readings.ticks)
        self.samples_in += n
        identity = self._identity
        if identity is None or readings.boot != identity.boot:
            self.dropped.add(BEFORE_IDENTITY if identity is None else Reason.OLD_BOOT, n)
            return []
        if (fault := _fault(readings, n)) is not None:
            self.dropped.add(fault, n)
            return []
        sequence, ticks = self._counters.unwrapped(readings, identity)
        good = self._good(readings, identity, self._new(sequence, ticks, identity))
        if not good.any():
            return []
        last = int(np.flatnonzero(good)[-1])
        device_s = float(ticks[last]) * identity.tick_period_s
        self.clock.observe(device_s, readings.receive_time_ns)
        self._measure(int(sequence[last]), device_s)
        # A sample cannot come in before it was taken, whatever the fit says.
        late_ns = max(0, self.clock.host_ns(device_s) - readings.receive_time_ns)
        return [self._batch(readings, identity, sequence, ticks, run, late_ns) for run in _runs(good)]

    def _new(self, sequence: Counts, ticks: Counts, identity: Identity) -> Bools:
        """Which samples are news; counts the others, and what is missing before them.

        A device that for a second sends old numbers only has begun anew without saying so (some draw the same boot
        number each time): that is a boot, under a number of our making.
        """
        new, missing = self._counters.follow(sequence, ticks)
        if missing:
            self.events.add("missing_samples", missing)
        self._drop(Reason.DUPLICATE, ~new)
        self._old = 0 if new.any() else self._old + len(ticks)
        if self._old >= max(2, identity.rate_hz):
            refused = self._old
            self.events.add("reboots_unsaid")
            self._unsaid += 1
            self._begin()
            self.samples_in += refused  # they were of this boot already
            self.dropped.add(Reason.DUPLICATE, refused)
        return new

    def _good(self, readings: Readings, identity: Identity, new: Bools) -> Bools:
        """Which of the new samples may be published; counts the others."""
        limit = min(MAX_RATE, PLAUSIBLE * identity.gyro_range) if identity.gyro_range else MAX_RATE
        finite = np.isfinite(readings.gyro).all(axis=1)
        with np.errstate(invalid="ignore"):
            plausible = (np.abs(readings.gyro) <= limit).all(axis=1)
            if readings.accel is not None:
                finite &= np.isfinite(readings.accel).all(axis=1)
                plausible &= (np.abs(readings.accel) <= MAX_ACCEL).all(axis=1)
        self._drop(Reason.NON_FINITE, new & ~finite)
        self._drop(Reason.RANGE, new & finite & ~plausible)
        good: Bools = new & finite & plausible
        return good

    def _drop(self, reason: Reason, which: Bools) -> None:
        n = int(np.count_nonzero(which))
        if n:
            self.dropped.add(reason, n)

    def _batch(
        self,
        readings: Readings,
        identity: Identity,
        sequence: Counts,
        ticks: Counts,
        run: slice,
        late_ns: int,
    ) -> SampleBatch:
        gyro = np.ascontiguousarray(readings.gyro[run], np.float32)
        n, first = len(gyro), int(sequence[run.start])
        flags = np.zeros(n, np.uint32)
        if identity.gyro_range:
            flags[(np.abs(gyro) >= CLIPPED_AT * identity.gyro_range).any(axis=1)] = SampleFlag.CLIPPED
        if self._next is not None and first != self._next:
            flags[0] |= np.uint32(SampleFlag.AFTER_GAP)
            self.events.add("gaps")
        self._next = first + n
        self.samples += n
        accel = readings.accel
        return SampleBatch(
            device=self._names[0],
            boot=self.boot or 0,
            sequence=first,
            receive_time_ns=readings.receive_time_ns,
            start_time_ns=max(0, self.clock.host_ns(float(ticks[run.start]) * identity.tick_period_s) - late_ns),
            tick_period_s=identity.tick_period_s,
            clock_rate=self.clock.rate,
            ticks=ticks[run].astype(np.uint64),
            gyro=gyro,
            accel=None if accel is None else np.ascontiguousarray(accel[run], np.float32),
            temperature_c=self._temperature(readings, run),
            flags=flags,
        )

    def _temperature(self, readings: Readings, run: slice) -> NDArray[np.float32] | None:
        """The column, or None where a value of it is unusable: no reason to lose the rates."""
        if readings.temperature_c is None:
            return None
        column = readings.temperature_c[run]
        with np.errstate(invalid="ignore"):
            if (np.abs(column) <= MAX_CELSIUS).all():
                return np.ascontiguousarray(column, np.float32)
        self.events.add(_NO_TEMPERATURE, len(column))
        return None

    def _measure(self, sequence: int, device_s: float) -> None:
        """Samples per host second over the last ten seconds or so, missing ones included."""
        if self._rate_from is None:
            self._rate_from = (sequence, device_s)
        since, since_s = self._rate_from
        if device_s - since_s >= 1.0:
            self._measured_rate_hz = (sequence - since) / ((device_s - since_s) * self.clock.rate)
        if device_s - since_s >= _RATE_WINDOW_S:
            self._rate_from = (sequence, device_s)


def _fault(readings: Readings, n: int) -> Reason | None:
    """Why readings cannot be taken at all: columns of different lengths, counters that no device reaches."""
    accel, temperature_c = readings.accel, readings.temperature_c
    whole = (
        n > 0
        and readings.gyro.shape == (n, 3)
        and (accel is None or accel.shape == (n, 3))
        and (temperature_c is None or temperature_c.shape == (n,))
    )
    if not whole:
        return Reason.LENGTH
    if not 0 <= readings.sequence < _MAX_COUNT or int(readings.ticks.max()) >= _MAX_COUNT:
        return Reason.RANGE
    return None


def _runs(good: Bools) -> list[slice]:
    """The unbroken runs of True, none longer than a batch may be."""
    edges = [0, len(good)]
    if not good.all():
        edges = np.flatnonzero(np.diff(good.astype(np.int8), prepend=0, append=0)).tolist()
    return [
        slice(begin, min(begin + MAX_SAMPLES, end))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        for begin in range(start, end, MAX_SAMPLES)
    ]
