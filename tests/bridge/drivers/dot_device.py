"""A Movella DOT as its BLE service specification describes it, for tests only: characteristics, and what they do."""

import struct
import zlib

Three = tuple[float, float, float]
INFO, DEVICE_CONTROL, CONTROL, LONG, MEDIUM, BATTERY = 0x1001, 0x1002, 0x2001, 0x2002, 0x2003, 0x3001


def uuid(number: int) -> str:
    return f"1517{number:04X}-4947-11E9-8646-D663BD873D93"


def stuffed(payload: bytes) -> bytes:
    """COBS, from its paper, of a payload and its CRC-32; and a zero byte."""
    out, run = bytearray(), bytearray()
    for byte in payload + struct.pack("<I", zlib.crc32(payload)):
        if byte:
            run.append(byte)
            if len(run) == 254:
                out += b"\xff" + run
                run.clear()
        else:
            out += bytes((len(run) + 1,)) + run
            run.clear()
    return bytes(out + bytes((len(run) + 1,)) + run + b"\0")


def value(number: int, data: bytes) -> bytes:
    """A characteristic's value as the transport hands it to the driver."""
    return stuffed(struct.pack("<H", number) + data)


def rates(time_us: int, gyro: Three, accel: Three = (0.0, 0.0, 9.81)) -> bytes:
    """Rate quantities, filled up as the sensor does."""
    return struct.pack("<I6f", time_us % 2**32, *accel, *gyro).ljust(40, b"\0")


def custom_3(time_us: int, gyro: Three) -> bytes:
    return struct.pack("<I7f", time_us, 1.0, 0.0, 0.0, 0.0, *gyro).ljust(40, b"\0")


class Dot:
    """Reads, writes and values of its characteristics. Sample number i turns about x by i * 0.1 °/s."""

    def __init__(self, charge: int = 87) -> None:
        self.rate_hz, self.mode, self.measuring, self.charge = 60, 0, False, charge
        self.count = 0
        self.written: list[tuple[int, bytes]] = []

    def read(self, number: int) -> bytes:
        if number == INFO:
            built = struct.pack("<H5B", 2023, 7, 3, 12, 30, 0)
            return bytes(6) + bytes((2, 3, 1)) + built + bytes(4) + struct.pack("<Q", 0x1234) + b"XS-T02"
        return bytes((self.charge, 0))

    def write(self, number: int, data: bytes) -> None:
        self.written.append((number, data))
        if number == CONTROL:
            assert len(data) == 3
            assert data[0] == 1
            self.measuring, self.mode = data[1] == 1, data[2]
        elif number == DEVICE_CONTROL:
            assert len(data) == 32
            assert data[0] == 0x10, "only the output rate"
            assert not self.measuring, "it cannot be changed while measuring"
            self.rate_hz = struct.unpack_from("<H", data, 24)[0]

    def payload(self) -> bytes:
        assert self.measuring
        time_us, gyro = 1_000_000 + round(self.count * 1e6 / self.rate_hz), (0.1 * self.count, 1.0, -2.0)
        self.count += 1
        return rates(time_us, gyro) if self.mode == 21 else custom_3(time_us, gyro)
