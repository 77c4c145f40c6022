"""Queries and settings of a WitMotion device, at least 0.1 s apart. No I/O; time is an argument.

Nothing is saved on the device, so changes are lost at power-off. The registers are those of the WIT Standard
Communication Protocol; the battery's register is in the maker's Bluetooth 5.0 protocol. An answer over a serial line
does not name its register, so only one query is open at a time.
"""

import struct
from collections.abc import Sequence

import numpy as np

from bridge.drivers.driver import Battery, Notice
from bridge.drivers.request_queue import RequestQueue
from bridge.reasons.codes import Code, Sentence

CONTENT, RATE, VERSION, STILL_TIME, BATTERY = 0x02, 0x03, 0x2E, 0x63, 0x64
#: charge, %, by the voltage of the battery's one cell, 0.01 V, as the maker's app computes it
_CENTIVOLTS = (340, 350, 368, 370, 373, 377, 379, 382, 387, 393, 396, 399)
_PERCENT = (0, 5, 10, 15, 20, 30, 40, 50, 60, 75, 90, 100)
#: voltages of one cell; another value is that of a device without battery, or not measured yet
_CELL = range(250, 451)
_BATTERY_NS = 60_000_000_000
RATES_HZ = {1: 0.2, 2: 0.5, 3: 1.0, 4: 2.0, 5: 5.0, 6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}
_CODES = {rate_hz: code for code, rate_hz in RATES_HZ.items()}
TIME_ACCEL_GYRO = 0x07  # value of CONTENT
_UNLOCK = bytes.fromhex("FF AA 69 88 B5")
_READ = 0x27
_SPACING_S, _AGAIN_S = 0.1, 0.5
_TIMES = 3  # tries of a query, and of a setting that does not take effect
_OFF_OLD, _LONGEST = 1, 0xFFFF


class Settings(RequestQueue):
    """Queries and settings of one WitMotion device, and their progress.

    rate_hz: output data rate to set, Hz; 0 leaves it. writes: True allows changes of settings.
    firmware: "" until the device answers. sends_hz: output data rate that the device reports, Hz; 0 until it answers.
    """

    def __init__(self, rate_hz: float, *, writes: bool) -> None:
        self.firmware, self.sends_hz = "", 0.0
        self._wanted_hz = rate_hz
        self._writes = writes
        self._has_battery, self._battery_ns = False, 0
        super().__init__(_AGAIN_S, _TIMES, self._unanswered, _SPACING_S)

    def begin(self, *, checked: bool) -> None:
        """Restart all queries, because the device was opened or has booted.

        checked: True if the device uses the serial form of frames, with checksums.
        """
        self._checked, self._has_battery = checked, not checked
        self._told = {CONTENT: 0, STILL_TIME: 0}
        self.clear()
        for register in (VERSION, CONTENT, STILL_TIME):
            self._ask(register)

    @property
    def settled(self) -> bool:
        """True if all queries but that of the battery are answered, and no command waits to be sent."""
        return self.key in (None, BATTERY) and not self.sending

    def passed(self, now_ns: int) -> list[Notice]:
        """Advance the time to now_ns, ns since the Unix epoch, as RequestQueue does; query the battery once a minute."""
        if self._has_battery and self.key is None and now_ns - self._battery_ns >= _BATTERY_NS:
            self._battery_ns = now_ns
            self.add(BATTERY, _command(_READ, BATTERY))
        return super().passed(now_ns)

    def _unanswered(self) -> list[Notice]:
        """Give up all queries after one without an answer."""
        about_battery = self.key == BATTERY
        self.clear()
        return [] if about_battery else _notice(Code.MAY_CALIBRATE_ITSELF())

    def took(self, data: bytes) -> Sequence[Notice | Battery]:
        """Process the device's answer to a register query; return the notices and battery states that follow from it.

        data: little-endian 16-bit registers. Devices on Bluetooth put the number of the first register in front; on a
        serial line, the answer belongs to the last query.
        """
        register, values = self.key, struct.unpack(f"<{len(data) // 2}H", data)
        if register is None or self.sending:
            return []
        if not self._checked:
            if values[0] != register:
                return []
            values = values[1:]
        self.answered()
        match register:
            case 0x2E:
                self.firmware = str(values[0])
            case 0x02:
                self._sends(values[0], RATES_HZ.get(values[1], 0.0))
            case 0x63:
                return self._calibrates(values[0])
            case 0x64 if values[0] in _CELL:
                return [Battery(float(np.interp(values[0], _CENTIVOLTS, _PERCENT)))]
        return []

    def _sends(self, content: int, rate_hz: float) -> None:
        """Handle the reported content and rate; set them if they differ from the wanted ones."""
        self.sends_hz = rate_hz
        right = self._wanted_hz == rate_hz and (content == TIME_ACCEL_GYRO or not self._checked)
        if right or not (self._writes and self._wanted_hz) or self._told[CONTENT] == _TIMES:
            return
        self._told[CONTENT] += 1
        if self._checked:
            self.tell(_UNLOCK, _command(CONTENT, TIME_ACCEL_GYRO))
        self.tell(_UNLOCK, _command(RATE, _CODES[self._wanted_hz]))
        self._ask(CONTENT)

    def _calibrates(self, still_time: int) -> list[Notice]:
        """Turn the gyro auto-calibration off, or give a notice.

        Older devices: 0 is on, 1 is off. Newer devices: calibrates after this many ms of rest, and cannot be turned
        off.
        """
        off = _OFF_OLD if still_time in (0, _OFF_OLD) else _LONGEST
        if still_time != off and self._writes and self._told[STILL_TIME] < _TIMES:
            self._told[STILL_TIME] += 1
            self.tell(_UNLOCK, _command(STILL_TIME, off))
            self._ask(STILL_TIME)
            return []
        if still_time == _OFF_OLD:
            return _notice(None)
        if not still_time:
            return _notice(Code.CALIBRATES_ITSELF())
        return _notice(Code.CALIBRATES_ITSELF_AT_REST(duration_s=f"{1e-3 * still_time:.3g}"))

    def _ask(self, register: int) -> None:
        self.add(register, _UNLOCK, _command(_READ, register))


def _notice(said: Sentence | None) -> list[Notice]:
    return [Notice("gyro auto-calibration", said)]


def _command(register: int, value: int) -> bytes:
    return bytes((0xFF, 0xAA, register, value & 0xFF, value >> 8))
