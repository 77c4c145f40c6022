"""Boots of a device that numbers none: told apart by what its clock does, or by its own words."""

import secrets
from collections.abc import Callable
from enum import Enum, auto

from bridge.wire.messages import BootCause

_BACK_S = 0.5  # a clock that goes back further than datagrams overtake each other
_AHEAD_S = 1.0  # beyond what host time says
_CONFIRMED = 3  # samples that agree: a single one may be damaged where the protocol has no check
_AGREE_S = 1.0
_SKEW = 0.002


def draw_boot() -> int:
    """A number no other boot has."""
    return secrets.randbits(64)


class Time(Enum):
    """What a sample's time is to the boot."""

    GOES_ON = auto()
    ODD = auto()  # not to be believed, unless the next ones agree
    BEGINS = auto()  # the first of a boot


class Boots:
    """Which boot a sample is of, and its time unwrapped. All times are arguments.

    tick_period_s: of the device's clock, None where it has none; it wraps at 2**tick_bits.
    number: 0 before the first sample. cause: how it is known. tick: of the latest sample, unwrapped since the boot began.
    A device whose clock has gone on while its port was closed is in the same boot as before.
    """

    def __init__(self, tick_period_s: float | None, tick_bits: int = 64, draw: Callable[[], int] = draw_boot) -> None:
        self.number = 0
        self.cause = BootCause.UNKNOWN
        self.tick = 0
        self._period_s = tick_period_s
        self._whole = 1 << tick_bits
        self._draw = draw
        self._raw = 0  # as sent, of the latest that was believed
        self._heard_ns = 0
        self._odd: list[int] = []
        self._opened = self._said = False

    def opened(self) -> None:
        """The way to the device was opened: the next sample may be of another boot."""
        self._opened = True
        self._odd.clear()

    def said(self) -> None:
        """The device said that it has booted."""
        self._said = True

    def observe(self, tick: int, receive_time_ns: int) -> Time:
        """Place a sample by its tick, as sent; a device without a clock may give anything."""
        if self._said or self.number == 0:
            return self._begin(BootCause.POWER_UP if self._said else BootCause.PORT_OPENED, tick, receive_time_ns)
        if self._period_s is None:
            if self._opened:
                return self._begin(BootCause.PORT_OPENED, tick, receive_time_ns)
            return Time.GOES_ON
        passed_s = max(0.0, (receive_time_ns - self._heard_ns) * 1e-9)
        step = self._step(tick, passed_s)
        step_s = step * self._period_s
        if self._opened:
            if abs(step_s - passed_s) > _AHEAD_S + _SKEW * passed_s:
                young = tick * self._period_s < passed_s  # it has been on for less than it was away
                return self._begin(BootCause.POWER_UP if young else BootCause.PORT_OPENED, tick, receive_time_ns)
            self._opened = False
        elif not -_BACK_S <= step_s <= _AHEAD_S + 1.5 * passed_s:
            if not self._confirmed(tick):
                return Time.ODD
            if tick < self._raw:
                return self._begin(BootCause.POWER_UP, tick, receive_time_ns)
        self._odd.clear()
        self.tick += step
        self._raw, self._heard_ns = tick, receive_time_ns
        return Time.GOES_ON

    def _step(self, tick: int, passed_s: float) -> int:
        """Ticks since the latest, with the turns of the counter that bring it nearest to the time that has passed."""
        expected = round(passed_s / self._period_s) if self._period_s else 0
        half = self._whole // 2
        return expected + (tick - self._raw - expected + half) % self._whole - half

    def _confirmed(self, tick: int) -> bool:
        """Whether enough leaps in a row agree with each other."""
        if self._odd and not 0 <= (tick - self._odd[-1]) * (self._period_s or 0.0) <= _AGREE_S:
            self._odd.clear()
        self._odd.append(tick)
        return len(self._odd) >= _CONFIRMED

    def _begin(self, cause: BootCause, tick: int, receive_time_ns: int) -> Time:
        self.number, self.cause = self._draw() or 1, cause
        self.tick = self._raw = tick
        self._heard_ns = receive_time_ns
        self._odd.clear()
        self._opened = self._said = False
        return Time.BEGINS
