"""Boot detection for a device that numbers none: by jumps of its clock, or by its own messages."""

import secrets
from collections.abc import Callable
from enum import Enum, auto
from typing import NamedTuple

from bridge.wire.messages import BootCause

_BACK_S = 0.5  # a clock that goes back further than datagrams overtake each other
_AHEAD_S = 1.0  # beyond what host time says
_CONFIRMED = 3  # samples that agree: a single one may be damaged where the protocol has no check
_AGREE_S = 1.0
_SKEW = 0.002
_WIDE_S = 10 * 365.25 * 86_400  # a clock that does not wrap within this does not wrap
# After a silence of this part of its turn any time of a clock that wraps is near some turn of it: it has to be where it should;
# and where more than this part of a turn is as near as that, what it says is chance.
_SILENT, _CHANCE = 0.1, 0.005


def draw_boot() -> int:
    """A number no other boot has."""
    return secrets.randbits(64)


class Time(Enum):
    """What a sample's time is to the boot."""

    GOES_ON = auto()
    ODD = auto()  # not to be believed, unless the next ones agree
    BEGINS = auto()  # the first of a boot


class _Heard(NamedTuple):
    """A sample that was believed: its tick as sent, unwrapped, and when it came."""

    raw: int
    tick: int
    at_ns: int


class BootDetector:
    """Which boot a sample is of, and its time unwrapped. All times are arguments.

    To take two boots for one is dangerous, for a calibration would go on; to take one for two costs a calibration.
    So whatever a clock that began anew at power-up can have led to is a boot, once three samples agree; but for a boot
    that lasted less than two seconds, which looks like datagrams that overtake each other.

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
        self._wraps = tick_period_s is not None and self._whole * tick_period_s < _WIDE_S
        self._draw = draw
        self._last = self._before = _Heard(0, 0, 0)  # the latest two
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
        step, passed_s = self._step(self._last, tick, receive_time_ns)
        if self._fits(step, passed_s, tick):
            return self._goes_on(self._last, step, tick, receive_time_ns)
        before, before_s = self._step(self._before, tick, receive_time_ns)
        if not self._opened and self._fits(before, before_s, tick):
            # It was the latest that was damaged, within what could be believed.
            return self._goes_on(self._before, before, tick, receive_time_ns)
        if not self._confirmed(tick):
            return Time.ODD
        young = tick * self._period_s < passed_s  # it has been on for less than it was silent
        if tick < self._last.raw or young or self._opened or self._wraps:
            cause = BootCause.PORT_OPENED if self._opened and not young else BootCause.POWER_UP
            return self._begin(cause, tick, receive_time_ns)
        return self._goes_on(self._last, step, tick, receive_time_ns)

    def _fits(self, step: int, passed_s: float, tick: int) -> bool:
        """Whether a clock that was not begun anew can have gone on by so many ticks while so much host time passed."""
        period_s = self._period_s or 0.0
        step_s = step * period_s
        behind_s, slack_s = passed_s - step_s, _AHEAD_S + _SKEW * passed_s
        turn_s = self._whole * period_s
        if self._wraps and passed_s > _SILENT * turn_s:
            return abs(behind_s) <= slack_s <= max(2 * _AHEAD_S, _CHANCE * turn_s)
        if self._opened:
            return abs(behind_s) <= slack_s
        if behind_s > slack_s and tick * period_s < passed_s:
            return False  # held up for long, or begun anew meanwhile
        return -_BACK_S <= step_s <= _AHEAD_S + 1.5 * passed_s

    def _goes_on(self, since: _Heard, step: int, tick: int, receive_time_ns: int) -> Time:
        self._opened = False
        self._odd.clear()
        self.tick = since.tick + step
        self._before, self._last = since, _Heard(tick, self.tick, receive_time_ns)
        return Time.GOES_ON

    def _step(self, since: _Heard, tick: int, receive_time_ns: int) -> tuple[int, float]:
        """Ticks since a sample, with the turns of the counter that bring it nearest to the time that has passed, and that."""
        passed_s = max(0.0, (receive_time_ns - since.at_ns) * 1e-9)
        expected = round(passed_s / self._period_s) if self._period_s else 0
        half = self._whole // 2
        plain = (tick - since.raw + half) % self._whole - half
        return expected + (plain - expected + half) % self._whole - half, passed_s

    def _confirmed(self, tick: int) -> bool:
        """Whether enough leaps in a row agree with each other."""
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
