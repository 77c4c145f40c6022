"""Intake of one device: events in, valid batches out, everything else counted by reason.

Pure: no clock, no thread. At any moment samples_in = samples published + the sum of dropped, since the boot began.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Event, Identity, Readings
from bridge.ingest import plausibility
from bridge.ingest.bad_sample_ratio import BadSampleRatio
from bridge.ingest.counters import Counters, Counts
from bridge.ingest.device_info import Account, News
from bridge.ingest.sensor_faults import SensorFaults
from bridge.ingest.timeline import Stamps, Timeline
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentence, Sentences
from bridge.wire.checks import MAX_TEXTS
from bridge.wire.messages import BootCause, DeviceInfo, SampleBatch, SampleFlag
from bridge.wire.refusal import Reason, Tally

BEFORE_IDENTITY = "before_identity"
_NO_TEMPERATURE, _RATE_DIFFERS, _LATE = "temperature_missing", "rate_differs", "late"
_RATE_CHANGED = "rate_changed"
_BAD = frozenset({"clipped", "stuck", "not_a_number", "temperature_step"})  # among the events: samples that are no good
_MISSING = "missing_samples"
_ODD = 0x9E3779B97F4A7C15  # makes boot numbers that nobody else draws
_INSTEAD_OF_0 = 1  # boot 0 is for devices that are not heard

Bools = NDArray[np.bool_]


class Intake:
    """One device. `take` its events in the order of arrival; `info` has the counts."""

    def __init__(self, device: str, bridge: str, driver: str, place: str) -> None:
        self.events = Tally()  # reboots, gaps, missing samples, reconnections: over the life of the bridge
        self.driver = driver
        self.said: list[str] = []  # for the log; whoever writes it empties it
        self.host_set_ns = 0  # what is published is by a clock so much ahead of that of the readings
        self._device = device
        self._account = Account(device, bridge, driver, place)
        self._identity: Identity | None = None
        self._unsaid = 0  # reboots since the identity's that the device did not tell
        self._begin()

    def _begin(self) -> None:
        """Reset the state that belongs to one boot."""
        self.timeline = Timeline()
        self._silent = 0  # samples missing in silences that are counted
        self._shares = BadSampleRatio()
        self.samples_in = 0
        self.samples = 0
        self.dropped = Tally()
        self._counters = Counters()
        self._old = 0  # samples in a row that were no news
        self._next: int | None = None  # the sequence that would go on without a hole
        self._sensor = SensorFaults(self.events)

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
        """The batches that an event completes, in order."""
        if isinstance(event, Identity):
            return self._greet(event)
        if isinstance(event, Readings):
            return [batch for readings in self._ready(event) for batch in self._read(readings)]
        self._account.note(event)
        return []

    def release(self) -> list[SampleBatch]:
        """Readings that were held in doubt of a gap before them, as batches: no more readings are expected."""
        return [batch for readings in self.timeline.release() for batch in self._read(readings)]

    def overflowed(self, batch: SampleBatch) -> None:
        """Count a batch that was dropped before it could be published."""
        if batch.boot == self.boot:
            self.samples -= len(batch)
            self.dropped.add(Reason.OVERFLOW, len(batch))
        self.events.add("overflows")

    def news(self, faults: dict[str, int], trouble: Sentences = ()) -> News:
        """What is counted of the device by now, its driver's faults among the events, and what troubles it."""
        events = self.events.as_dict()
        # A driver may have seen the same change.
        counts = {**events, **{label: max(n, events.get(label, 0)) for label, n in faults.items()}}
        return self._account.news(self._identity, self.dropped.as_dict(), counts, trouble)

    def info(self, time_ns: int, faults: dict[str, int], trouble: Sentences = ()) -> DeviceInfo:
        """What is known of the device at time_ns; boot 0 before it said who it is. Its driver's faults become events."""
        news = self.news(faults, trouble)
        info = self._account.info(self._identity, self.boot or 0, self.timeline, self.samples, time_ns, news)
        bad = {label: n for label, n in news.events.items() if label in _BAD}
        if said := self._shares.notable(time_ns, self.samples_in, {**bad, **news.dropped}):
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
            self._rate_changed(self.timeline.told(self._identity.rate_hz, identity.rate_hz))
        self._identity = identity
        return released

    def _ready(self, readings: Readings) -> list[Readings]:
        """What may be read now: a gap of a device that tells no time must be known before its samples are numbered."""
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
        if (batch := self._plain(readings, identity)) is not None:
            return [batch]
        sequence, ticks = self._counters.unwrapped(readings, identity)
        good = self._good(readings, identity, self._new(sequence, ticks, identity))
        if not good.any():
            return []
        at = np.flatnonzero(good)
        self._count_silent()
        sequence, ticks = sequence + self.timeline.missing, ticks[at] + self.timeline.missing
        stamps = self._stamps(int(sequence[at[-1]]), ticks, readings.receive_time_ns, identity)
        # The good samples before a run are as many as its stamps come after the first.
        return [
            self._batch(readings, identity, int(sequence[run.start]), run, stamps, int(np.searchsorted(at, run.start)))
            for run in plausibility.runs(good)
        ]

    def _plain(self, readings: Readings, identity: Identity) -> SampleBatch | None:
        """The batch of readings that just go on, with nothing to count of any sample; None, and nothing done, of others.

        Almost all are so, and what is found here of all samples together, `_read` finds sample by sample.
        """
        going = self._counters.going_on(readings, identity)
        if going is None or not identity.has_clock or self.timeline.missing:
            return None
        if not plausibility.plain(readings, identity.gyro_range):
            return None
        sequence, ticks = going
        self._counters.went_on(sequence, ticks)
        self._old = 0
        n = len(ticks)
        stamps = self._stamps(sequence + n - 1, ticks, readings.receive_time_ns, identity)
        return self._batch(readings, identity, sequence, slice(0, n), stamps, 0)

    def _stamps(self, last: int, ticks: Counts, receive_time_ns: int, identity: Identity) -> Stamps:
        """When good samples were taken; last is the number of their last."""
        if self.timeline.observe(last, int(ticks[-1]), receive_time_ns, identity):
            self.events.add(_RATE_DIFFERS)
        if self.timeline.changes(identity):
            self._rate_changed(self.timeline.changed)
        return self.timeline.stamps(ticks, receive_time_ns, identity)

    def _rate_changed(self, change: Sentence | None) -> None:
        self.events.add(_RATE_CHANGED)
        if change is not None:
            self.said.append(english(change))

    def _count_silent(self) -> None:
        if missing := self.timeline.missing - self._silent:
            self._silent = self.timeline.missing
            self.events.add(_MISSING, missing)

    def _new(self, sequence: Counts, ticks: Counts, identity: Identity) -> Bools:
        """Which samples are news; counts the others, and what is missing before them.

        A device that for a second sends old numbers only has begun anew without saying so (some draw the same boot
        number each time): that is a boot, under a number of our making.
        """
        new, missing, repeated, overtaken, backward = self._counters.follow(sequence, ticks)
        if missing:
            self.events.add(_MISSING, missing)
        # Those that newer ones overtook are not sorted in: all after a hole would have to wait for what seldom comes.
        self._drop(Reason.DUPLICATE, repeated)
        self._drop(Reason.REORDERED, overtaken)
        self._drop(Reason.BACKWARD, backward)
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
        finite, plausible = plausibility.sound(readings, identity.gyro_range)
        good: Bools = new & plausible
        if not good.all():
            self._drop(Reason.NON_FINITE, int(np.count_nonzero(new & ~finite)))
            self._drop(Reason.RANGE, int(np.count_nonzero(new & finite & ~plausible)))
        return good

    def _drop(self, reason: Reason, n: int) -> None:
        if n:
            self.dropped.add(reason, n)

    def _batch(
        self, readings: Readings, identity: Identity, sequence: int, run: slice, stamps: Stamps, begin: int
    ) -> SampleBatch:
        """The samples of a run as a batch; `begin` is where its stamps begin."""
        gyro = np.ascontiguousarray(readings.gyro[run], np.float32)
        n = len(gyro)
        temperature_c = plausibility.temperature(readings, run)
        if temperature_c is None and readings.temperature_c is not None:
            self.events.add(_NO_TEMPERATURE, n)
        flags = self._sensor.flags(stamps.time_s[begin : begin + n], gyro, temperature_c, identity.gyro_range)
        if readings.clipped is not None:
            self._sensor.told(flags, readings.clipped[run])
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
