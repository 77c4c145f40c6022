"""A WitMotion device as its manual describes it, for tests only: frames, and registers that can be read and written."""

import struct
from datetime import datetime, timedelta

RATES = {6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}
UNLOCK = bytes.fromhex("FFAA6988B5")
Raw = tuple[int, int, int]


def checked(kind: int, data: bytes) -> bytes:
    body = bytes((0x55, kind)) + data
    return body + bytes((sum(body) % 256,))


def motion(kind: int, xyz: Raw, word: int = 0) -> bytes:
    return checked(kind, struct.pack("<4h", *xyz, word))


def time(at: datetime) -> bytes:
    calendar = (at.year - 2000, at.month, at.day, at.hour, at.minute, at.second, at.microsecond // 1000)
    return checked(0x50, struct.pack("<6BH", *calendar))


def unchecked(accel: Raw, gyro: Raw, angle: Raw = (1, 2, 3)) -> bytes:
    return b"\x55\x61" + struct.pack("<9h", *accel, *gyro, *angle)


class WitDevice:
    """Its clock is told by `advance`. bluetooth: the form without a sum. deaf: it answers nothing."""

    def __init__(self, *, bluetooth: bool = False, deaf: bool = False, old: bool = True) -> None:
        self.bluetooth, self.deaf = bluetooth, deaf
        self.saved = {0x02: 0x1E, 0x03: 6, 0x04: 2, 0x2E: 4711, 0x61: 0, 0x63: 0 if old else 1000, 0x64: 0}
        self.commands: list[bytes] = []
        self.count, self._owed = 0, 0.0
        self.power_up()

    def power_up(self) -> None:
        self.registers = dict(self.saved)
        self.locked = True
        self.clock = datetime(2000, 1, 1)  # noqa: DTZ001 - the device knows no zone
        self.out = b""

    @property
    def rate_hz(self) -> float:
        return RATES[self.registers[3]]

    def receive(self, data: bytes) -> None:
        assert len(data) % 5 == 0
        for at in range(0, len(data), 5):
            command = data[at : at + 5]
            self.commands.append(command)
            if not self.deaf:
                self._obey(command)

    def _obey(self, command: bytes) -> None:
        register, value = command[2], int.from_bytes(command[3:], "little")
        if command == UNLOCK:
            self.locked = False
        elif register == 0x27:
            words = [self.registers.get(value + i, 0) for i in range(8)]
            if self.bluetooth:
                self.out += b"\x55\x71" + struct.pack("<9H", value, *words)
            else:
                self.out += checked(0x5F, struct.pack("<4H", *words[:4]))
        elif not self.locked:
            self.registers[register] = value

    def cycle(self) -> bytes:
        """One sample; its gyro counts samples, so that each can be told from the others."""
        self.clock += timedelta(seconds=1 / self.rate_hz)
        self.count += 1
        accel, gyro = (self.count % 1000, 0, 2048), (self.count, -self.count, 5)
        out, self.out = self.out, b""
        if self.bluetooth:
            return out + unchecked(accel, gyro)
        content = self.registers[2]
        frames = (
            time(self.clock),
            motion(0x51, accel, 2512),
            motion(0x52, gyro, 7),
            motion(0x53, (1, 2, 3), 4711),
            motion(0x54, (4, 5, 6)),
        )
        return out + b"".join(frame for bit, frame in enumerate(frames) if content >> bit & 1)

    def advance(self, seconds: float) -> bytes:
        """What it sends meanwhile."""
        self._owed += seconds
        out = b""
        while self._owed >= 1 / self.rate_hz:
            self._owed -= 1 / self.rate_hz
            out += self.cycle()
        return out
