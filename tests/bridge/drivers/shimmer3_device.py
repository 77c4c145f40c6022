"""A Shimmer3 as its protocol document describes it, for tests only: commands, answers, data packets, with and without CRC."""

import struct

Three = tuple[int, int, int]
TICKS = 320  # from sample to sample: 102.4 Hz
CALIBRATION = struct.pack(">6h9b", 10, -20, 30, 6550, 6560, 6540, 0, -100, 0, -100, 0, 0, 0, 0, -100)
ACCEL_CALIBRATION = struct.pack(">6h9b", 2047, 2047, 2047, 83, 83, 83, 0, -100, 0, -100, 0, 0, 0, 0, -100)
EVEN = struct.pack(">6h9b", 0, 0, 0, 10_000, 10_000, 10_000, 0, -100, 0, -100, 0, 0, 0, 0, -100)  # 100 counts for 1 °/s
CHANNELS = bytes((0x00, 0x01, 0x02, 0x0A, 0x0B, 0x0C))


def crc(frame: bytes) -> bytes:
    """Bit by bit: polynomial 0x1021, seed 0xB0CA, an odd frame filled up with a zero byte."""
    register = 0xB0CA
    for byte in frame + b"\0" * (len(frame) % 2):
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return struct.pack("<H", register)


def summed(frame: bytes) -> bytes:
    return frame + crc(frame)


def packet(time: int, gyro: Three, accel: Three = (2047, 2047, 1233)) -> bytes:
    ticks = struct.pack("<I", time % 2**24)[:3]
    return b"\0" + ticks + struct.pack("<3h", *accel) + struct.pack(">3h", *gyro)


def inquiry(ticks: int = TICKS, channels: bytes = CHANNELS) -> bytes:
    return b"\xff\x02" + struct.pack("<H", ticks) + bytes(4) + bytes((len(channels), 1)) + channels


def calibrations(gyro: bytes = CALIBRATION) -> bytes:
    return b"\xff\x2d" + ACCEL_CALIBRATION + gyro + b"\xff" * 21 + ACCEL_CALIBRATION


class Shimmer:
    """knows_crc: whether its firmware knows SET_CRC. gyro: its stored calibration. lose: each n-th sent byte is lost."""

    def __init__(self, *, knows_crc: bool = True, gyro: bytes = CALIBRATION, version: int = 3, lose: int = 0) -> None:
        self.knows_crc, self.gyro, self.version, self.lose = knows_crc, gyro, version, lose
        self.crc = self.streaming = False
        self.ticks, self.channels = TICKS, CHANNELS
        self.adc, self.charger = 2850, 0x80
        self.count, self.sent, self._owed = 0, 0, 0.0
        self.commands: list[int] = []
        self._in, self.out = b"", b""

    def receive(self, data: bytes) -> None:
        self._in += data
        arguments = {0x8B: 1, 0x05: 2, 0x08: 3}
        while self._in:
            command = self._in[0]
            size = 0 if command == 0x8B and not self.knows_crc else arguments.get(command, 0)
            if len(self._in) <= size:
                return
            given, self._in = self._in[1 : 1 + size], self._in[1 + size :]
            self._obey(command, given)

    def _obey(self, command: int, given: bytes) -> None:
        self.commands.append(command)
        answers = {
            0x3F: b"\x25" + bytes((self.version,)),
            0x2E: b"\x2f" + struct.pack("<HHBB", 3, 0, 16, 4),
            0x4B: b"\x4a\x01",
            0x2C: calibrations(self.gyro)[1:],
            0x01: inquiry(self.ticks, self.channels)[1:],
            0x95: b"\x8a\x94" + struct.pack("<HB", self.adc, self.charger),
        }
        if command == 0x20:
            self.streaming = False
        elif command == 0x07:
            self.streaming = True
        elif command == 0x8B and self.knows_crc:
            self.crc = given == b"\x02"
        elif command == 0x05:
            [self.ticks] = struct.unpack("<H", given)
        elif command == 0x08:
            assert given == b"\xc0\0\0"
        elif command not in answers:
            return  # an unknown byte is discarded
        self._send(b"\xff" + answers.get(command, b""))

    def _send(self, frame: bytes) -> None:
        for byte in summed(frame) if self.crc else frame:
            self.sent += 1
            if not self.lose or self.sent % self.lose:
                self.out += bytes((byte,))

    def advance(self, seconds: float) -> bytes:
        if self.streaming:
            self._owed += seconds * 32768 / self.ticks
            while self._owed >= 1:
                self._owed -= 1
                self._send(packet(1000 + self.ticks * self.count, (self.count % 30_000, 100, -100)))
                self.count += 1
        out, self.out = self.out, b""
        return out
