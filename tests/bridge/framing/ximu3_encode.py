"""Encodes samples, temperature, battery and notifications as binary messages of an x-IMU3; the inverse of ximu3.py."""

import struct

import numpy as np
from numpy.typing import NDArray

G = 9.80665
_SAMPLE = np.dtype([("kind", "u1"), ("time_us", "<u8"), ("gyro_dps", "<f4", 3), ("accel_g", "<f4", 3)])


def inertial(
    time_us: NDArray[np.integer], gyro: NDArray[np.floating], accel: NDArray[np.floating] | None
) -> list[bytes]:
    """Encode samples, one message each: time_us (n,), gyro (n, 3) rad/s, accel (n, 3) m/s², zeros if None."""
    samples = np.zeros(len(time_us), _SAMPLE)
    samples["kind"] = _kind("I")
    samples["time_us"] = time_us
    samples["gyro_dps"] = np.degrees(gyro)
    if accel is not None:
        samples["accel_g"] = accel / G
    return [_line(sample.tobytes()) for sample in samples]


def temperature(time_us: int, celsius: float) -> bytes:
    """Encode a temperature in °C."""
    return _line(struct.pack("<BQf", _kind("T"), time_us, celsius))


def battery(time_us: int, percent: float, *, charging: bool) -> bytes:
    """Encode the battery's charge in %; the voltage, which is unknown, is 0."""
    return _line(struct.pack("<BQ3f", _kind("B"), time_us, percent, 0.0, float(charging)))


def notification(time_us: int, text: str) -> bytes:
    """Encode a text for people."""
    return _line(struct.pack("<BQ", _kind("N"), time_us) + text.encode("ascii", "replace"))


def _kind(letter: str) -> int:
    return 0x80 + ord(letter)


def _line(message: bytes) -> bytes:
    return message.replace(b"\xdb", b"\xdb\xdd").replace(b"\n", b"\xdb\xdc") + b"\n"
