"""Sample times of one boot, by the device's clock and by the host's, and the measured sample rate.

A device that tells time is believed; for one that tells none (`Identity.has_clock`) time is made of the count of its samples.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Identity, Readings
from bridge.ingest.arrival_clock import TICK_S, ArrivalClock, SilenceDetector
from bridge.ingest.clock_fit import ClockFit
from bridge.ingest.counter_unwrapping import Counts
from bridge.ingest.sample_rate import SampleRateMeter
from bridge.reasons.codes import Code, Sentence, Sentences

_LATE_NS = 1_000_000_000
_ODD_CLOCK = 0.02  # from the host's
_OTHER = 0.02  # of the rate


class SampleTimes(NamedTuple):
    """Times of n samples that came in at once: ticks (n,) rising, of tick_period_s; device_s (n,) as the device tells it.

    last_ns: host time of the last; ns_per_s: of host time, by device time. judged: whether lateness can be told.
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
        """(n,) device time."""
        return np.asarray(self.ticks * self.tick_period_s, np.float64)

    def host_ns(self, at: int) -> int:
        """When sample `at` was taken."""
        return max(0, self.last_ns - round(float(self.device_s[-1] - self.device_s[at]) * self.ns_per_s))

    def late(self) -> NDArray[np.bool_] | None:
        """(n,) which came in over 1 s after they were taken; None if none did."""
        if not self.judged or self.receive_time_ns - self.host_ns(0) <= _LATE_NS:  # which the first is, if any
            return None
        before_ns = np.rint((self.device_s[-1] - self.device_s) * self.ns_per_s).astype(np.int64)
        return np.asarray(self.receive_time_ns - np.maximum(0, self.last_ns - before_ns) > _LATE_NS)


class SampleClock:
    """Fed in the order of arrival; pure. changed: how the rate changed last, if it did."""

    def __init__(self) -> None:
        self.clock = ClockFit()
        self.rate = SampleRateMeter()
        self.changed: Sentence | None = None
        self._sent_hz = self._first_hz = 0.0  # at which it is known to have sent; what it said first
        self._silences, self._made = SilenceDetector(), ArrivalClock()

    @property
    def missing(self) -> int:
        """Samples that a device without a clock has left out so far, by the silences."""
        return self._silences.missing

    def hold(self, readings: Readings, last_tick: int, identity: Identity) -> list[Readings]:
        """What may be read now: after a silence of a device that tells no time it takes a while to know."""
        device_s = (last_tick + self.missing) * identity.tick_period_s
        late_s = (readings.receive_time_ns - self.clock.host_ns(device_s)) * 1e-9 if self.clock.sure else 0.0
        return self._silences.take(readings, late_s, identity.tick_period_s * self.clock.rate)

    def release(self) -> list[Readings]:
        """What is held, when no more is expected."""
        return self._silences.release()

    def observe(self, sequence: int, tick: int, receive_time_ns: int, identity: Identity) -> bool:
        """The last good sample of readings; whether its rate begins to differ from what was told."""
        device_s = tick * identity.tick_period_s
        self.clock.observe(device_s, receive_time_ns)
        return self.rate.observe(sequence, device_s, self.clock.rate, identity.rate_hz)

    def told(self, before_hz: float, rate_hz: float) -> Sentence:
        """The device says another rate within its boot: it is measured anew. That it is as at first is no news."""
        self.rate, self._sent_hz = SampleRateMeter(), 0.0
        self._first_hz = self._first_hz or before_hz
        said = _changed(before_hz, rate_hz)
        self.changed = said if rate_hz != self._first_hz else None
        return said

    def changes(self, identity: Identity) -> bool:
        """Whether a device with a clock is now known to send at another rate than before, though it does not say so."""
        hz, before_hz = self.rate.steady_hz, self._sent_hz or identity.rate_hz
        if not (identity.has_clock and hz and before_hz) or abs(hz / before_hz - 1) <= _OTHER:
            self._sent_hz = self._sent_hz or hz
            return False
        was_known = self._sent_hz > 0
        self._sent_hz = hz
        if was_known:
            self.changed = _changed(before_hz, hz)
        return was_known

    def stamps(self, ticks: Counts, receive_time_ns: int, identity: Identity) -> SampleTimes:
        """The times of good samples (n,), rising, up to the one observed."""
        rate = self.clock.rate
        device_s = np.asarray(ticks * identity.tick_period_s, np.float64)
        # A sample cannot come in before it was taken, whatever the fit says.
        last_ns = min(self.clock.host_ns(float(device_s[-1])), receive_time_ns)
        shown = ticks, identity.tick_period_s, rate
        if not identity.has_clock:
            shown = self._made.ticks(ticks, identity.tick_period_s * rate), TICK_S, 1.0
        return SampleTimes(*shown, device_s, last_ns, rate * 1e9, receive_time_ns, self.clock.sure)

    def notices(self, identity: Identity) -> Sentences:
        """What a person should know of it."""
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


def _changed(before_hz: float, now_hz: float) -> Sentence:
    return Code.RATE_CHANGED(then_hz=f"{before_hz:.3g}", now_hz=f"{now_hz:.3g}")
