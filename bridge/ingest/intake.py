"""Intake of one device: converts a driver's events to valid batches, and counts all other samples by reason.

No I/O, clock or thread. Each sample received in a boot (from one restart of the device to the next) is either published
or counted as dropped. Readings still held for a possible gap are not yet counted as received.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Event, Identity, Readings
from bridge.ingest import plausibility
from bridge.ingest.bad_sample_ratio import BadSampleRatio
from bridge.ingest.counter_unwrapping import CounterUnwrapper, Counts, Followed
from bridge.ingest.device_info import DeviceInfoBuilder
from bridge.ingest.sample_clock import SampleClock, SampleTimes
from bridge.ingest.sensor_faults import SensorFaults
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentences
from bridge.wire.messages import BootCause, DeviceCalibration, DeviceInfo, SampleBatch, SampleFlag
from bridge.wire.refusal import Reason, Tally
from bridge.wire.validation import MAX_TEXTS

BEFORE_IDENTITY = "before_identity"
_NO_TEMPERATURE, _RATE_DIFFERS, _LATE = "temperature_missing", "rate_differs", "late"
_RATE_CHANGED = "rate_changed"
_BAD = frozenset({"clipped", "stuck", "not_a_number", "temperature_step"})  # events that count bad samples
_MISSING = "missing_samples"
_OF_ANOTHER_BOOT = "own_calibration_of_another_boot"
_ODD = 0x9E3779B97F4A7C15  # offset between boot numbers made here, which no device draws
_INSTEAD_OF_0 = 1  # boot 0 means that the device was not heard

Bools = NDArray[np.bool_]


class Intake:
    """Converts the events of one device to valid batches, and counts all other samples by reason.

    device, bridge: ids. driver: name of the driver. place: port or file of the device.
    Pass events to `take` in the order of arrival; `info` returns the counts.
    """

    def __init__(self, device: str, bridge: str, driver: str, place: str) -> None:
        self.events = Tally()  # reboots, gaps, missing samples, reconnections, over the bridge's life
        self.driver = driver
        self.said: list[str] = []  # log lines; the thread that logs them empties the list
        self.host_set_ns = 0  # published time minus the clock of the readings, ns
        self._device = device
        self._account = DeviceInfoBuilder(device, bridge, driver, place)
        self._identity: Identity | None = None
        self._unsaid = 0  # reboots since the identity that the device did not announce
        self._begin()

    def _begin(self) -> None:
        """Reset the state that belongs to one boot."""
        self.timeline = SampleClock()
        self._silent = 0  # samples missing in silences, already counted
        self._shares = BadSampleRatio()
        self.samples_in = 0
        self.samples = 0
        self.dropped = Tally()
        self._counters = CounterUnwrapper()
        self._old = 0  # consecutive samples that are not new
        self._next: int | None = None  # the next sequence number without a gap
        self._sensor = SensorFaults(self.events)
        self._calibration: DeviceCalibration | None = None  # the device's own

    @property
    def boot(self) -> int | None:
        """Published 64-bit boot number, never 0; None while the device has not identified itself."""
        if self._identity is None:
            return None
        return (self._identity.boot + self._unsaid * _ODD) % 2**64 or _INSTEAD_OF_0

    @property
    def has_clock(self) -> bool:
        """True if the device is known to have a clock; without one, sample times are derived from receive times."""
        return self._identity is not None and self._identity.has_clock

    def take(self, event: Event) -> list[SampleBatch]:
        """Process one event of the driver; return the batches that it completes, in order."""
        if isinstance(event, Identity):
            return self._greet(event)
        if isinstance(event, Readings):
            return [batch for readings in self._ready(event) for batch in self._read(readings)]
        if isinstance(event, DeviceCalibration):
            self._calibrated(event)
        else:
            self._account.note(event)
        return []

    def release(self) -> list[SampleBatch]:
        """Return batches of the readings held for a possible gap; call it when no more readings are expected."""
        return [batch for readings in self.timeline.release() for batch in self._read(readings)]

    def overflowed(self, batch: SampleBatch) -> None:
        """Count as dropped the samples of a batch that was discarded before it could be published."""
        if batch.boot == self.boot:
            self.samples -= len(batch)
            self.dropped.add(Reason.OVERFLOW, len(batch))
        self.events.add("overflows")

    def info(self, time_ns: int, faults: dict[str, int], trouble: Sentences = ()) -> DeviceInfo:
        """Return the DeviceInfo at time_ns (ns since the Unix epoch); its boot is 0 until the device has identified itself.

        faults: the driver's counts of unusable frames and samples, by label; the DeviceInfo contains them in `events`.
        trouble: reasons why the device cannot be read; () if it can.
        """
        events, dropped = self.events.as_dict(), self.dropped.as_dict()
        # The driver may have counted the same change.
        events |= {label: max(n, events.get(label, 0)) for label, n in faults.items()}
        counted = self.samples, time_ns, dropped, events, trouble
        info = self._account.info(self._identity, self.boot or 0, self.timeline, *counted)
        info = replace(info, calibration=self._calibration)
        bad = {label: n for label, n in events.items() if label in _BAD}
        if said := self._shares.notable(time_ns, self.samples_in, {**bad, **dropped}):
            info = replace(info, notices=(*info.notices, *said)[-MAX_TEXTS:])
        return info

    def _greet(self, identity: Identity) -> list[SampleBatch]:
        released: list[SampleBatch] = []
        if self._identity is None or identity.boot != self._identity.boot:
            released = self.release()
            self._unsaid = 0
            if self._identity is not None:
                self.events.add("reopened" if identity.boot_cause is BootCause.PORT_OPENED else "reboots")
                self._begin()
            elif self.samples_in:
                self.events.add(BEFORE_IDENTITY, self.samples_in)
                self._begin()
        elif identity.rate_hz != self._identity.rate_hz:
            self.events.add(_RATE_CHANGED)
            self.said.append(english(self.timeline.told(self._identity.rate_hz, identity.rate_hz)))
        self._identity = identity
        return released

    def _calibrated(self, own: DeviceCalibration) -> None:
        """Keep a calibration that the device made itself in this boot, and count one of another boot."""
        if self._identity is None or own.boot != self._identity.boot:
            self.events.add(_OF_ANOTHER_BOOT)
        else:
            self._calibration = replace(own, boot=self.boot or 0)

    def _ready(self, readings: Readings) -> list[Readings]:
        """Readings that may be numbered now; without a device clock, a possible gap must be settled first."""
        identity = self._identity
        if (
            identity is None
            or identity.has_clock
            or readings.boot != identity.boot
            or plausibility.fault(readings) is not None
        ):
            return [readings]
        _, ticks = self._counters.unwrapped(readings, identity)
        return self.timeline.hold(readings, int(ticks[-1]), identity)

    def _read(self, readings: Readings) -> list[SampleBatch]:
        n = len(readings.ticks)
        self.samples_in += n
        identity = self._identity
        if identity is None or readings.boot != identity.boot:
            self.dropped.add(BEFORE_IDENTITY if identity is None else Reason.OLD_BOOT, n)
            return []
        if (fault := plausibility.fault(readings)) is not None:
            self.dropped.add(fault, n)
            return []
        followed = self._counters.follow(readings, identity)
        self._count(followed, identity)
        good = self._good(readings, identity, followed.new)
        if good is not None and not good.any():
            return []
        self._count_silent()
        shift, ticks, last = self.timeline.missing, followed.ticks, n - 1
        if good is not None:
            ticks, last = ticks[good], int(np.flatnonzero(good)[-1])
        first = followed.first + shift
        stamps = self._stamps(first + last, ticks + shift if shift else ticks, readings.receive_time_ns, identity)
        # The number of good samples before a run is the index of its first time stamp.
        return [
            self._batch(
                readings,
                identity,
                first + run.start,
                run,
                stamps,
                run.start if good is None else int(np.count_nonzero(good[: run.start])),
            )
            for run in plausibility.runs(n, good)
        ]

    def _stamps(self, last: int, ticks: Counts, receive_time_ns: int, identity: Identity) -> SampleTimes:
        """Times of the good samples; `last` is the sequence number of the last one."""
        if self.timeline.observe(last, int(ticks[-1]), receive_time_ns, identity):
            self.events.add(_RATE_DIFFERS)
        return self.timeline.stamps(ticks, receive_time_ns, identity)

    def _count_silent(self) -> None:
        if missing := self.timeline.missing - self._silent:
            self._silent = self.timeline.missing
            self.events.add(_MISSING, missing)

    def _count(self, followed: Followed, identity: Identity) -> None:
        """Count the samples that are not new, and those missing before them.

        A device that sends only old numbers for a second has rebooted without saying so (some devices draw the same
        boot number each time). That counts as a new boot, with a boot number made here.
        """
        if followed.new is None:
            self._old = 0
            return
        if followed.missing:
            self.events.add(_MISSING, followed.missing)
        # Overtaken samples are dropped, not sorted in: otherwise all samples after a gap would have to wait.
        self._drop(Reason.DUPLICATE, followed.repeated)
        self._drop(Reason.REORDERED, followed.overtaken)
        self._drop(Reason.BACKWARD, followed.backward)
        self._old = 0 if followed.new.any() else self._old + len(followed.new)
        if self._old >= max(2, identity.rate_hz):
            refused = self._old
            self.events.add("reboots_unsaid")
            self._unsaid += 1
            self._begin()
            self.samples_in += refused  # these samples belong to the new boot
            self.dropped.add(Reason.DUPLICATE, refused)

    def _good(self, readings: Readings, identity: Identity, new: Bools | None) -> Bools | None:
        """Mask of the new samples that may be published, None if all may; counts the others."""
        sound = plausibility.sound(readings, identity.gyro_range)
        if sound is None:
            return new
        finite, plausible = sound
        news = np.ones(len(finite), bool) if new is None else new
        self._drop(Reason.NON_FINITE, int(np.count_nonzero(news & ~finite)))
        self._drop(Reason.RANGE, int(np.count_nonzero(news & finite & ~plausible)))
        return np.asarray(news & plausible)

    def _drop(self, reason: Reason, n: int) -> None:
        if n:
            self.dropped.add(reason, n)

    def _batch(
        self, readings: Readings, identity: Identity, sequence: int, run: slice, stamps: SampleTimes, begin: int
    ) -> SampleBatch:
        """Make a batch of a run of samples; `begin` is the index of its first time stamp."""
        gyro = np.ascontiguousarray(readings.gyro[run], np.float32)
        n = len(gyro)
        temperature_c = plausibility.temperature(readings, run)
        if temperature_c is None and readings.temperature_c is not None:
            self.events.add(_NO_TEMPERATURE, n)
        clipped = None if readings.clipped is None else readings.clipped[run]
        flags = self._sensor.flags(stamps.time_s[begin : begin + n], gyro, temperature_c, identity.gyro_range, clipped)
        part = slice(begin, begin + n)
        if (all_late := stamps.late()) is not None and (late := all_late[part]).any():
            flags[late] |= np.uint32(SampleFlag.LATE)
            self.events.add(_LATE, int(np.count_nonzero(late)))
        if self._next is not None and sequence != self._next:
            flags[0] |= np.uint32(SampleFlag.AFTER_GAP)
            self.events.add("gaps")
        self._next = sequence + n
        self.samples += n
        return SampleBatch(
            device=self._device,
            boot=self.boot or 0,
            sequence=sequence,
            receive_time_ns=max(0, stamps.receive_time_ns + self.host_set_ns),
            start_time_ns=max(0, stamps.host_ns(begin) + self.host_set_ns),
            tick_period_s=stamps.tick_period_s,
            clock_rate=stamps.clock_rate,
            ticks=stamps.ticks[part].astype(np.uint64),
            gyro=gyro,
            accel=None if readings.accel is None else np.ascontiguousarray(readings.accel[run], np.float32),
            temperature_c=temperature_c,
            flags=flags,
        )
