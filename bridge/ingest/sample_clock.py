"""Sample times of one boot, by the device's clock and by the host's clock, and the measured sample rate.

For a device without a clock (`Identity.has_clock`), the device time is derived from the sample count.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Identity, Readings
from bridge.ingest.arrival_clock import TICK_S, ArrivalClock, SilenceDetector
from bridge.ingest.clock_fit import ClockFit
from bridge.ingest.counter_unwrapping import Counts
from bridge.reasons.codes import Code, Sentence, Sentences

_WINDOW_S = 10.0
_DIFFERS, _AGREES = 0.02, 0.01  # of the nominal rate
_LATE_NS = 1_000_000_000
_ODD_CLOCK = 0.02  # relative to the host's clock


class SampleTimes(NamedTuple):
    """Times of n samples that were received together.

    ticks (n,): device time, rising, in ticks of tick_period_s. clock_rate: host seconds per second of ticks.
    device_s (n,): device time used by the clock fit, s. last_ns: host time of the last sample, ns since the Unix epoch.
    ns_per_s: host ns per second of device_s. receive_time_ns: receive time of the last sample, ns since the Unix epoch.
    judged: True if the clock fit is accurate enough to detect late samples.
    """

    ticks: Counts
    tick_period_s: float
    clock_rate: float
    device_s: NDArray[np.float64]
    last_ns: int
    ns_per_s: float
    receive_time_ns: int
    judged: bool

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Device times (n,) of the samples in s: ticks times tick_period_s."""
        return np.asarray(self.ticks * self.tick_period_s, np.float64)

    def host_ns(self, at: int) -> int:
        """Return the host time, ns since the Unix epoch, at which the sample with index `at` was taken."""
        return max(0, self.last_ns - round(float(self.device_s[-1] - self.device_s[at]) * self.ns_per_s))

    def late(self) -> NDArray[np.bool_] | None:
        """Return a mask (n,), True for samples received more than 1 s after they were taken.

        None if there are no such samples, or if the clock fit is not accurate enough to detect them.
        """
        if not self.judged or self.receive_time_ns - self.host_ns(0) <= _LATE_NS:  # if any sample is late, the first is
            return None
        before_ns = np.rint((self.device_s[-1] - self.device_s) * self.ns_per_s).astype(np.int64)
        return np.asarray(self.receive_time_ns - np.maximum(0, self.last_ns - before_ns) > _LATE_NS)


class SampleClock:
    """Sample times and sample rate of one boot, from readings in the order of arrival. No I/O.

    clock: fit of the device's clock to the host's. rate: meter of the sample rate in Hz.
    changed: a sentence on the last change of the nominal rate; None if it did not change.
    """

    def __init__(self) -> None:
        self.clock = ClockFit()
        self.rate = SampleRateMeter()
        self.changed: Sentence | None = None
        self._first_hz = 0.0  # rate announced first
        self._silences, self._made = SilenceDetector(), ArrivalClock()

    @property
    def missing(self) -> int:
        """Number of samples missing so far in silences of a device without a clock."""
        return self._silences.missing

    def hold(self, readings: Readings, last_tick: int, identity: Identity) -> list[Readings]:
        """Add new readings; return the readings, new and held, to publish now.

        After a silence of a device without a clock, readings are held until it is known if samples are missing.
        last_tick: unwrapped tick count of the last sample in `readings`. identity: gives the tick period.
        """
        device_s = (last_tick + self.missing) * identity.tick_period_s
        late_s = (readings.receive_time_ns - self.clock.host_ns(device_s)) * 1e-9 if self.clock.sure else 0.0
        return self._silences.take(readings, late_s, identity.tick_period_s * self.clock.rate)

    def release(self) -> list[Readings]:
        """Return the readings held after a silence; call it when no more are expected."""
        return self._silences.release()

    def observe(self, sequence: int, tick: int, receive_time_ns: int, identity: Identity) -> bool:
        """Add the last good sample of readings to the clock fit and to the measurement of the sample rate.

        sequence, tick: unwrapped. receive_time_ns: receive time, ns since the Unix epoch. identity: gives the tick period
        and the nominal sample rate. Returns True if the measured sample rate begins to differ from the nominal one.
        """
        device_s = tick * identity.tick_period_s
        self.clock.observe(device_s, receive_time_ns)
        return self.rate.observe(sequence, device_s, self.clock.rate, identity.rate_hz)

    def told(self, before_hz: float, rate_hz: float) -> Sentence:
        """Process a new nominal sample rate that the device announced within a boot; return a sentence on the change.

        before_hz, rate_hz: nominal sample rates before and now, Hz. The rate measurement restarts. `changed` becomes
        None if the device returns to the nominal rate with which the boot began.
        """
        self.rate = SampleRateMeter()
        self._first_hz = self._first_hz or before_hz
        said = Code.RATE_CHANGED(then_hz=f"{before_hz:.3g}", now_hz=f"{rate_hz:.3g}")
        self.changed = said if rate_hz != self._first_hz else None
        return said

    def stamps(self, ticks: Counts, receive_time_ns: int, identity: Identity) -> SampleTimes:
        """Return the times of good samples. First call `observe` with the last of these samples.

        ticks (n,): tick counts, unwrapped and rising. receive_time_ns: receive time of the last sample, ns since the
        Unix epoch.
        identity: gives the tick period.
        """
        rate = self.clock.rate
        device_s = np.asarray(ticks * identity.tick_period_s, np.float64)
        # A sample cannot be received before it was taken, whatever the fit says.
        last_ns = min(self.clock.host_ns(float(device_s[-1])), receive_time_ns)
        shown = ticks, identity.tick_period_s, rate
        if not identity.has_clock:
            shown = self._made.ticks(ticks, identity.tick_period_s * rate), TICK_S, 1.0
        return SampleTimes(*shown, device_s, last_ns, rate * 1e9, receive_time_ns, self.clock.sure)

    def notices(self, identity: Identity) -> Sentences:
        """Return sentences for the user about the device's clock and sample rate; () if they are as the device states.

        identity: gives the nominal sample rate, and whether the device has a clock.
        """
        notices = [] if self.changed is None else [self.changed]
        clock, told, measured = self.clock, f"{identity.rate_hz:.4g}", f"{self.rate.hz:.4g}"
        if not identity.has_clock and clock.measured:
            notices.append(Code.RATE_MEASURED(rate_hz=measured, percent=f"{100 * clock.rate_error / clock.rate:.2g}"))
        elif not identity.has_clock:
            notices.append(Code.RATE_PRESUMED(rate_hz=told))
        if self.rate.differs:
            notices.append(Code.RATE_DIFFERS(measured_hz=measured, told_hz=told))
            if identity.has_clock and abs(clock.rate - 1) > _ODD_CLOCK:
                notices.append(Code.CLOCK_DIFFERS(times=f"{1 / clock.rate:.4g}"))
        return tuple(notices)


class SampleRateMeter:
    """Measures the sample rate of one boot, and compares it with the nominal rate.

    hz: samples per second of host time over a window of 1 to 10 s, missing samples included; 0 until known.
    differs: True once hz is more than 2 % off the nominal rate, until it is within 1 %.
    """

    def __init__(self) -> None:
        self.hz = 0.0
        self.differs = False
        self._since: tuple[int, float] | None = None  # sequence and device time at the start of the window

    def observe(self, sequence: int, device_s: float, clock_rate: float, nominal_hz: float) -> bool:
        """Add a sample by its number and device time; return True if the rate begins to differ from the nominal one.

        sequence: unwrapped number of the sample. device_s: device time, s. clock_rate: host seconds per device second.
        nominal_hz: nominal sample rate, Hz; 0 if unknown.
        """
        if self._since is None:
            self._since = (sequence, device_s)
        since, since_s = self._since
        if device_s - since_s < 1.0:
            return False
        self.hz = (sequence - since) / ((device_s - since_s) * clock_rate)
        if device_s - since_s >= _WINDOW_S:
            self._since = (sequence, device_s)
        before, off = self.differs, abs(self.hz / nominal_hz - 1) if nominal_hz else 0.0
        self.differs = off > (_AGREES if before else _DIFFERS)
        return self.differs and not before
