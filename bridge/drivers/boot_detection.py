"""Boot detection, by jumps of the device's clock or by its own report, for devices that send no boot number.

A boot is the time from one power-up or restart of a device to the next.
"""

import secrets
from collections.abc import Callable
from enum import Enum, auto
from typing import NamedTuple

from bridge.wire.messages import BootCause

_BACK_S = 0.5  # overtaking datagrams set a clock back by less
_AHEAD_S = 1.0  # device time ahead of host time
_CONFIRMED = 3  # samples that must agree: where the protocol has no checksum, a single sample may be damaged
_AGREE_S = 1.0
_SKEW = 0.002
_WIDE_S = 10 * 365.25 * 86_400  # a clock with a longer turn counts as never wrapping
# _SILENT: after a silence of this part of its turn, a wrapping clock must be at its expected time.
# _CHANCE: where the tolerance exceeds this part of a turn, agreement is chance.
_SILENT, _CHANCE = 0.1, 0.005


def draw_boot() -> int:
    """Return a random 64-bit number to identify a new boot of a device (the time from one restart to the next)."""
    return secrets.randbits(64)


class Time(Enum):
    """Classification of a sample's device time: continues the current boot, is implausible (ODD), or begins a new boot.

    A sample with an implausible time is to be ignored. If three such samples in a row agree with each other, the third
    is accepted.
    """

    GOES_ON = auto()
    ODD = auto()  # ignored, unless the next samples agree with each other
    BEGINS = auto()  # first sample of a boot


class _Heard(NamedTuple):
    """An accepted sample: tick as sent, tick unwrapped, receive time in ns."""

    raw: int
    tick: int
    at_ns: int


class BootDetector:
    """Assigns samples to boots and unwraps their tick counts, for devices that send no boot number. No I/O.

    tick_period_s: seconds per tick; None for a device without a clock. The clock wraps at 2**tick_bits ticks.
    draw: returns a new boot number.
    number: current boot number, 0 before the first sample. cause: how the boot was detected.
    tick: tick of the latest sample, unwrapped since the boot began.

    Method: each tick is compared with the tick expected from the elapsed host time. Three samples in a row that deviate
    but agree with each other begin a new boot, if a clock restarted at power-up could explain them. Without a clock,
    each opening of the port begins a new boot.
    If a boot were missed, an old calibration would be applied to a restarted sensor, which is dangerous. A boot
    detected by mistake only costs a calibration. So the detector prefers a new boot in doubt.
    If a device restarts within two seconds of power-up, the new boot may stay undetected. Its clock then steps back no
    further than between datagrams received out of order.
    A device whose clock continued while its port was closed stays in the same boot.
    """

    def __init__(self, tick_period_s: float | None, tick_bits: int = 64, draw: Callable[[], int] = draw_boot) -> None:
        self.number = 0
        self.cause = BootCause.UNKNOWN
        self.tick = 0
        self._period_s = tick_period_s
        self._whole = 1 << tick_bits
        self._wraps = tick_period_s is not None and self._whole * tick_period_s < _WIDE_S
        self._draw = draw
        self._last = self._before = _Heard(0, 0, 0)  # the latest two accepted samples
        self._odd: list[int] = []
        self._opened = self._said = False

    def opened(self) -> None:
        """Report that the port was opened: the next sample may belong to another boot."""
        self._opened = True
        self._odd.clear()

    def said(self) -> None:
        """Report that the device announced a boot: the next sample begins it."""
        self._said = True

    def observe(self, tick: int, receive_time_ns: int) -> Time:
        """Classify a sample by its tick and receive time; update `number`, `cause` and `tick`.

        tick: tick count as sent; any value for a device without a clock. receive_time_ns: ns since the Unix epoch.
        """
        if self._said or self.number == 0:
            return self._begin(BootCause.POWER_UP if self._said else BootCause.PORT_OPENED, tick, receive_time_ns)
        if self._period_s is None:
            if self._opened:
                return self._begin(BootCause.PORT_OPENED, tick, receive_time_ns)
            return Time.GOES_ON
        step, passed_s = self._step(self._last, tick, receive_time_ns)
        if self._fits(step, passed_s, tick):
            return self._goes_on(self._last, step, tick, receive_time_ns)
        before, before_s = self._step(self._before, tick, receive_time_ns)
        if not self._opened and self._fits(before, before_s, tick):
            # The latest sample was damaged, though within the limits.
            return self._goes_on(self._before, before, tick, receive_time_ns)
        if not self._confirmed(tick):
            return Time.ODD
        young = tick * self._period_s < passed_s  # on for a shorter time than it was silent
        if tick < self._last.raw or young or self._opened or self._wraps:
            cause = BootCause.PORT_OPENED if self._opened and not young else BootCause.POWER_UP
            return self._begin(cause, tick, receive_time_ns)
        return self._goes_on(self._last, step, tick, receive_time_ns)

    def _fits(self, step: int, passed_s: float, tick: int) -> bool:
        """Return whether a clock that did not restart can advance by `step` ticks in passed_s seconds of host time."""
        period_s = self._period_s or 0.0
        step_s = step * period_s
        behind_s, slack_s = passed_s - step_s, _AHEAD_S + _SKEW * passed_s
        turn_s = self._whole * period_s
        if self._wraps and passed_s > _SILENT * turn_s:
            return abs(behind_s) <= slack_s <= max(2 * _AHEAD_S, _CHANCE * turn_s)
        if self._opened:
            return abs(behind_s) <= slack_s
        if behind_s > slack_s and tick * period_s < passed_s:
            return False  # long delayed, or restarted meanwhile
        return -_BACK_S <= step_s <= _AHEAD_S + 1.5 * passed_s

    def _goes_on(self, since: _Heard, step: int, tick: int, receive_time_ns: int) -> Time:
        self._opened = False
        self._odd.clear()
        self.tick = since.tick + step
        self._before, self._last = since, _Heard(tick, self.tick, receive_time_ns)
        return Time.GOES_ON

    def _step(self, since: _Heard, tick: int, receive_time_ns: int) -> tuple[int, float]:
        """Ticks since a sample, with the number of turns nearest to the elapsed host time; and that time in s."""
        passed_s = max(0.0, (receive_time_ns - since.at_ns) * 1e-9)
        expected = round(passed_s / self._period_s) if self._period_s else 0
        half = self._whole // 2
        plain = (tick - since.raw + half) % self._whole - half
        return expected + (plain - expected + half) % self._whole - half, passed_s

    def _confirmed(self, tick: int) -> bool:
        """Return whether enough odd times in a row agree with each other."""
        if self._odd and not 0 <= (tick - self._odd[-1]) * (self._period_s or 0.0) <= _AGREE_S:
            self._odd.clear()
        self._odd.append(tick)
        return len(self._odd) >= _CONFIRMED

    def _begin(self, cause: BootCause, tick: int, receive_time_ns: int) -> Time:
        self.number, self.cause = self._draw() or 1, cause
        self.tick = tick
        self._before = self._last = _Heard(tick, tick, receive_time_ns)
        self._odd.clear()
        self._opened = self._said = False
        return Time.BEGINS
