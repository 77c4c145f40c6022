"""What an x-IMU3 is asked and told: a command at a time, each again until it is answered. Time is an argument.

Keys and values are those of the user manual, "Individual settings". Nothing is saved on request, but the device itself
saves its settings when it is switched off.
"""

import json
from collections import deque
from typing import Any

from bridge.drivers.driver import Notice
from bridge.framing.ximu3 import Reply, plain

SAMPLES_HZ = 400.0  # a message is the mean of `divisor` samples
PING, FIRMWARE, HARDWARE = "ping", "firmware_version", "hardware_version"
CORRECTION, DIVISOR = "gyroscope_offset_correction_enabled", "inertial_message_rate_divisor"
_ASKED = (PING, FIRMWARE, HARDWARE, CORRECTION, DIVISOR)
_AGAIN_S, _TIMES = 1.0, 10
_WRITES = 3  # of one setting, for each time it is asked about
_MAX_DIVISOR = 4000
_MAX_TEXT = 31
_MOST_QUEUED = 32


class Settings:
    """One device's. chosen_hz: the rate it is to have, None for the one it has. writes: whether it may be told anything.

    name, serial, firmware, hardware: empty until answered. divisor: None until answered.
    coming_us: the period that it was told to have, until it is seen.
    """

    def __init__(self, chosen_hz: float | None, *, writes: bool) -> None:
        self.name = self.serial = self.firmware = self.hardware = ""
        self.divisor: int | None = None
        self.coming_us: float | None = None
        self._usual = None if chosen_hz is None else divisor_of(chosen_hz)
        self._special: int | None = None
        self._may_write = writes
        self._noticed = ""
        self.ask()

    def ask(self) -> None:
        """Ask everything: the device was opened, or has booted."""
        self._open = {plain(key): key for key in _ASKED}
        self._queue = deque((_command(key, None) for key in _ASKED), maxlen=_MOST_QUEUED)
        self._written = {CORRECTION: 0, DIVISOR: 0}
        self._times, self._again_ns = 0, 0

    @property
    def answered(self) -> bool:
        """Nothing is waited for."""
        return not self._open

    def pace(self, rate_hz: float | None) -> None:
        """Another rate for a while, or None: the usual one again. Nothing as long as it is not known what is usual."""
        self._special = None if rate_hz is None else divisor_of(rate_hz)
        self._written[DIVISOR] = 0
        self._set_divisor()

    def command(self) -> bytes:
        """The next one to send; empty if none."""
        return self._queue.popleft() if self._queue else b""

    def passed(self, now_ns: int) -> list[Notice]:
        """Ask again what was not answered, for a while; then say so."""
        if not self._open or self._times > _TIMES:
            return []
        if not self._again_ns:
            self._again_ns = now_ns + round(_AGAIN_S * 1e9)
        if now_ns < self._again_ns:
            return []
        self._times += 1
        self._again_ns = now_ns + round(_AGAIN_S * 1e9)
        if self._times <= _TIMES:
            self._queue.extend(_command(key, None) for key in self._open.values())
            return []
        if plain(CORRECTION) in self._open:
            return self._notice(
                "it does not answer, so whether it corrects its gyroscope's bias by itself is not known"
            )
        return []

    def took(self, reply: Reply) -> list[Notice]:
        """An answer came."""
        asked = self._open.pop(reply.key, None) is not None
        value = reply.value
        if reply.key == plain(CORRECTION):
            return self._corrects(value, asked=asked)
        if reply.key == plain(DIVISOR):
            self._divides(value)
        elif reply.key == plain(PING) and isinstance(value, dict):
            self.name, self.serial = _text(value.get("name")), _text(value.get("sn"))
        elif reply.key == plain(FIRMWARE):
            self.firmware = _text(value)
        elif reply.key == plain(HARDWARE):
            self.hardware = _text(value)
        return []

    def _corrects(self, value: object, *, asked: bool) -> list[Notice]:
        """It follows its own bias, which would be a bias that leaps: for those who calibrate it, or it is turned off."""
        if value is False:
            return self._notice("")
        if not asked or (value is not True and not self._written[CORRECTION]):
            return []
        if value is True and self._may_write and self._written[CORRECTION] < _WRITES:
            self._write(CORRECTION, value=False)
            return []
        return self._notice(
            "it corrects its gyroscope's bias by itself, which disturbs the calibration: "
            "turn “Gyroscope offset correction enabled” off in its settings"
        )

    def _divides(self, value: object) -> None:
        if not (type(value) is int and 1 <= value <= _MAX_DIVISOR):
            self.coming_us = None  # refused
            return
        self.divisor = value
        if self._usual is None:
            self._usual = value
        self._set_divisor()

    def _set_divisor(self) -> None:
        if self._usual is None or self.divisor is None or not self._may_write:
            return
        wanted = self._special or self._usual
        if wanted == self.divisor:
            return
        if self._written[DIVISOR] == _WRITES:
            self.coming_us = None
            return
        self._write(DIVISOR, value=wanted)
        self.coming_us = 1e6 * wanted / SAMPLES_HZ

    def _write(self, key: str, *, value: object) -> None:
        self._written[key] += 1
        self._open[plain(key)] = key
        self._times, self._again_ns = 0, 0
        self._queue += [_command(key, value), _command("apply", None)]

    def _notice(self, text: str) -> list[Notice]:
        if text == self._noticed:
            return []
        self._noticed = text
        return [Notice("on-device correction", text)]


def divisor_of(rate_hz: float) -> int:
    """What gives the nearest rate."""
    return min(max(1, round(SAMPLES_HZ / rate_hz)), _MAX_DIVISOR)


def _command(key: str, value: object) -> bytes:
    return json.dumps({key: value}, separators=(",", ":")).encode() + b"\n"


def _text(value: Any) -> str:
    if not isinstance(value, str):
        return ""
    return "".join(c for c in value[:_MAX_TEXT] if c.isprintable())
