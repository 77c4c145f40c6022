"""Queries and settings of an x-IMU3. No I/O; time is an argument.

Keys and values are those of the user manual, "Individual settings". No save command is sent, but the device itself
saves its settings when it is switched off.
"""

import json
from collections import Counter
from typing import Any

from bridge.drivers.driver import Notice
from bridge.drivers.request_queue import RequestQueue
from bridge.framing.ximu3 import Reply, plain
from bridge.reasons.codes import Code, Sentence

SAMPLES_HZ = 400.0  # an inertial message is the mean of `divisor` samples
PING, FIRMWARE, HARDWARE = "ping", "firmware_version", "hardware_version"
CORRECTION, DIVISOR = "gyroscope_offset_correction_enabled", "inertial_message_rate_divisor"
_ASKED = (PING, FIRMWARE, HARDWARE, CORRECTION, DIVISOR)
_AGAIN_S, _TIMES = 1.0, 10
_WRITES = 3  # writes of one setting per query
_MAX_DIVISOR = 4000
_MAX_TEXT = 31


class Settings(RequestQueue):
    """Queries and settings of one x-IMU3, and their progress.

    chosen_hz: output data rate to set, Hz; None leaves it. writes: True allows changes of settings.
    name, serial, firmware, hardware: "" until the device answers.
    coming_us: new sample period that was set but is not yet seen in the samples, µs; None otherwise.
    """

    def __init__(self, chosen_hz: float | None, *, writes: bool) -> None:
        self.name = self.serial = self.firmware = self.hardware = ""
        self._divisor = None if chosen_hz is None else divisor_of(chosen_hz)
        self._may_write = writes
        self._written = Counter[str]()  # since the queries began
        self._unapplied = False
        self.coming_us: float | None = None
        super().__init__(_AGAIN_S, _TIMES, self._unanswered)

    def ask(self) -> None:
        """Restart all queries, because the device was opened or has booted."""
        self.clear()
        for key in _ASKED:
            self.add(plain(key), _command(key, None))
        self._written.clear()
        self.coming_us = None

    def took(self, reply: Reply) -> list[Notice]:
        """Process the device's answer to a query or setting; return the notices that follow from it.

        Changed settings take effect together, once all queries are answered.
        """
        asked = reply.key == self.key
        if asked:
            self.answered()
        notices = self._understood(reply, asked=asked)
        if self._unapplied and self.key is None:
            self._unapplied = False
            self.add("apply", _command("apply", None))
        return notices

    def _understood(self, reply: Reply, *, asked: bool) -> list[Notice]:
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
        """Handle the on-board bias correction, whose bias jumps disturb a calibration: turn it off, or give a notice."""
        if value is False:
            return _notice(None)
        if not asked or (value is not True and not self._written[CORRECTION]):
            return []
        if value is True and self._write(CORRECTION, value=False):
            return []
        return _notice(Code.CORRECTS_ITSELF())

    def _divides(self, value: object) -> None:
        wanted = self._divisor
        if wanted is not None and wanted != value and type(value) is int and self._write(DIVISOR, value=wanted):
            self.coming_us = 1e6 * wanted / SAMPLES_HZ

    def _write(self, key: str, *, value: object) -> bool:
        """Queue a setting; False if writing is not allowed, or was tried often enough."""
        if not self._may_write or self._written[key] == _WRITES:
            return False
        self._written[key] += 1
        self.add(plain(key), _command(key, value))
        self._unapplied = True
        return True

    def _unanswered(self) -> list[Notice]:
        self.clear()
        return _notice(Code.MAY_CORRECT_ITSELF())


def divisor_of(rate_hz: float) -> int:
    """Return the rate divisor, 1 to 4000, whose output data rate 400 Hz / divisor is nearest to rate_hz."""
    return min(max(1, round(SAMPLES_HZ / rate_hz)), _MAX_DIVISOR)


def _notice(said: Sentence | None) -> list[Notice]:
    return [Notice("on-device correction", said)]


def _command(key: str, value: object) -> bytes:
    return json.dumps({key: value}, separators=(",", ":")).encode() + b"\n"


def _text(value: Any) -> str:
    if not isinstance(value, str):
        return ""
    return "".join(c for c in value[:_MAX_TEXT] if c.isprintable())
