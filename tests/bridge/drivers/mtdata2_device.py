"""An Xsens MTi as its manual describes it, for tests only: messages, states, settings."""

import struct

F32, FP1220, FP1632, F64 = range(4)


def message(kind: int, data: bytes = b"") -> bytes:
    length = bytes((len(data),)) if len(data) < 255 else b"\xff" + struct.pack(">H", len(data))
    body = bytes((0xFF, kind)) + length + data
    return b"\xfa" + body + bytes((256 - sum(body) % 256 & 0xFF,))


def item(identifier: int, data: bytes) -> bytes:
    return struct.pack(">HB", identifier, len(data)) + data


def real(value: float, form: int) -> bytes:
    match form:
        case 0:
            return struct.pack(">f", value)
        case 1:
            return struct.pack(">i", round(value * 2**20))
        case 2:
            fixed = round(value * 2**32)
            return struct.pack(">I", fixed & 0xFFFFFFFF) + struct.pack(">h", fixed >> 32)
        case _:
            return struct.pack(">d", value)


def reals(identifier: int, values: tuple[float, ...], form: int = F32) -> bytes:
    return item(identifier | form, b"".join(real(value, form) for value in values))


class MtDevice:
    """restarts: its clock and its counter begin anew whenever it is told to measure. deaf: it answers nothing."""

    def __init__(self, *, restarts: bool = False, deaf: bool = False, timed: bool = True, rate_hz: int = 100) -> None:
        self.restarts, self.deaf, self.timed, self.rate_hz = restarts, deaf, timed, rate_hz
        self.measuring = True
        self.counter, self.ticks, self.count = 65_530, 4_294_960_000, 0
        self.received: list[int] = []
        self.out = b""
        self._in, self._owed = b"", 0.0
        self.extra = 0  # messages without a rate of turn between two with one

    def power_up(self) -> bytes:
        self.counter = self.ticks = 0
        self.measuring = True
        return message(0x3E)

    def receive(self, data: bytes) -> None:
        self._in += data
        while self._in:
            assert self._in[:2] == b"\xfa\xff"
            size = self._in[3] + 5
            one, self._in = self._in[:size], self._in[size:]
            assert sum(one[1:]) % 256 == 0
            self.received.append(one[2])
            if not self.deaf:
                self._obey(one[2], one[4:-1])

    def _obey(self, kind: int, data: bytes) -> None:
        answer = b""
        if kind == 0x3F:
            self.measuring = False
            return
        if kind == 0x30:
            self.measuring = False
        elif kind == 0x10:
            self.measuring = True
            if self.restarts:
                self.counter = self.ticks = 0
        elif self.measuring:
            self.out += message(0x42, b"\x04")
            return
        elif kind == 0x00:
            answer = bytes.fromhex("0012AB34")
        elif kind == 0x1C:
            answer = b"MTi-30-2A8G4".ljust(20)
        elif kind == 0x12:
            answer = bytes.fromhex("0104070000001100002233")
        elif kind == 0xC0:
            outputs = dict(struct.iter_unpack(">HH", data))
            self.rate_hz = outputs[0x8020]
            self.timed = 0x1060 in outputs
            answer = data
        self.out += message(kind + 1, answer)

    def measure(self) -> bytes:
        """One message; its gyro counts samples, so that each can be told from the others."""
        self.counter = (self.counter + 1) % 2**16
        self.ticks = (self.ticks + 10_000 // self.rate_hz) % 2**32
        self.count += 1
        items = item(0x1020, struct.pack(">H", self.counter))
        if self.timed:
            items += item(0x1060, struct.pack(">I", self.ticks))
        items += reals(0x4020, (0.0, 0.5, 9.75)) + reals(0x8020, (self.count / 1024, -0.25, 0.125))
        if self.count % 10 == 1:
            items += reals(0x0810, (37.625,))
        return message(0x36, items + item(0xE020, struct.pack(">I", 0x00400003)))

    def live(self, samples: int) -> bytes:
        """What it sends while it takes so many samples; answers first."""
        out, self.out = self.out, b""
        return out + (b"".join(self.measure() for _ in range(samples)) if self.measuring else b"")

    def advance(self, seconds: float) -> bytes:
        """What it sends meanwhile."""
        self._owed += seconds * self.rate_hz
        samples, self._owed = divmod(self._owed, 1)
        return self.live(int(samples))
