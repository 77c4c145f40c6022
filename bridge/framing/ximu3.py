"""Messages of an x-IMU3 device, without I/O: binary and ASCII messages in any mix, one message per line.

    C9 time numbers[6]          I,time,gx,gy,gz,ax,ay,az        a sample: °/s, g
    D4 time numbers[1]          T,time,celsius
    C2 time numbers[3]          B,time,percent,volts,status
    CE time text, C6 time text  N,time,text and F,time,text     a notification, an error
    {"key":value}                                               the answer to a command

The left column shows binary messages, whose first byte is given in hexadecimal; the right column the same in ASCII.
Binary numbers have the order of the ASCII message. Time is the device's clock in µs, 64-bit unsigned; its epoch is
not used. Binary numbers are float32, and time and numbers are little-endian. Angular rates are in °/s, accelerations in
g, the charge in percent. A line ends in 0A; in a binary line, 0A is escaped as DB DC and DB as DB DD. There is no
checksum: a damaged number that is still a number is not detected. Source: x-io Technologies, x-IMU3 user manual,
"Communication protocol".
"""

import math
import re
import struct
from typing import Any, NamedTuple

import msgspec

from bridge.framing.packets import BadPacket, Charge

LONGEST = 4096  # bytes; the limit of x-io's own reader
Vector = tuple[float, float, float]

_NUMBERS = {"I": 6, "T": 1, "B": 3}
_TEXTS = "NF"
# Ignored: magnetometer, high-g, attitudes, accelerations, AHRS status, accessory, sync, time code, signal, button; P D
# K G: reserved.
_OF_NO_USE = "MHQRALEUSYCWOPDKG"
_TIME = struct.Struct("<BQ")
_BINARY = {letter: struct.Struct(f"<BQ{n}f") for letter, n in _NUMBERS.items()}
_WHOLE = re.compile(rb"\d{1,20}\Z")
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
_STOOD_FOR = {0xDC: b"\n", 0xDD: b"\xdb"}
_CHARGING = 1
_MAX_TEXT = 127


class Inertial(NamedTuple):
    """Inertial sample of an x-IMU3: device time in µs, angular rate (x, y, z) in °/s, acceleration (x, y, z) in g."""

    time_us: int
    gyro_dps: Vector
    accel_g: Vector


class Temperature(NamedTuple):
    """Temperature message of an x-IMU3: sensor temperature in °C."""

    celsius: float


class Said(NamedTuple):
    """Text message of an x-IMU3 for the user. error: True for an error, False for a notification."""

    error: bool
    text: str


class Reply(NamedTuple):
    """Answer of an x-IMU3 to a command: normalised key (see `plain`) and JSON value."""

    key: str
    value: Any


Message = Inertial | Temperature | Charge | Said | Reply


def plain(key: str) -> str:
    """Normalise a setting's key as x-IMU3 devices compare it: lower case, letters and digits only."""
    return re.sub("[^a-z0-9]", "", key.lower())


def decode(line: bytes) -> Message | None:
    """Decode one line (without its end) as an x-IMU3 message; None for a kind of message that is ignored.

    Raises BadPacket, with the label to count, for a damaged line.
    """
    if line[0] == ord("{"):
        return _reply(line)
    line = line.removesuffix(b"\r") if line[0] < 0x80 else _unstuffed(line)
    if not line:
        return None
    letter = chr(line[0] & 0x7F)
    if line[0] < 0x80 and line[1:2] != b",":
        raise BadPacket("message_unknown")
    if letter in _NUMBERS:
        time_us, numbers = _binary(line, letter) if line[0] >= 0x80 else _ascii(line, letter)
        if not all(map(math.isfinite, numbers)):
            raise BadPacket("message_content")
        return _measured(letter, time_us, numbers)
    if letter in _TEXTS:
        return Said(letter == "F", _text(line))
    if letter in _OF_NO_USE:
        return None
    raise BadPacket("message_unknown")


def _measured(letter: str, time_us: int, numbers: tuple[float, ...]) -> Message:
    if letter == "I":
        return Inertial(time_us, (numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5]))
    if letter == "T":
        return Temperature(numbers[0])
    if not 0 <= numbers[0] <= 100:
        raise BadPacket("message_content")
    return Charge(numbers[0], round(numbers[2]) == _CHARGING)


def _unstuffed(line: bytes) -> bytes:
    first, *rest = line.split(b"\xdb")
    if not all(piece and piece[0] in _STOOD_FOR for piece in rest):
        raise BadPacket("message_escape")
    return first + b"".join(_STOOD_FOR[piece[0]] + piece[1:] for piece in rest)


def _binary(line: bytes, letter: str) -> tuple[int, tuple[float, ...]]:
    layout = _BINARY[letter]
    if len(line) != layout.size:
        raise BadPacket("message_length")
    _, time_us, *numbers = layout.unpack(line)
    return time_us, tuple(numbers)


def _ascii(line: bytes, letter: str) -> tuple[int, tuple[float, ...]]:
    _, time, *numbers = (field.strip() for field in line.split(b","))
    if len(numbers) != _NUMBERS[letter]:
        raise BadPacket("message_length")
    if not all(map(_NUMBER.match, numbers)):
        raise BadPacket("message_content")
    return _time_us(time), tuple(map(float, numbers))


def _time_us(field: bytes) -> int:
    if not _WHOLE.match(field) or int(field) >= 1 << 64:
        raise BadPacket("message_content")
    return int(field)


def _text(line: bytes) -> str:
    if line[0] >= 0x80:
        if len(line) < _TIME.size:
            raise BadPacket("message_length")
        raw = line[_TIME.size :]
    else:
        _, time, *rest = line.split(b",", 2)
        if not rest:
            raise BadPacket("message_length")
        _time_us(time)
        raw = rest[0]
    text = raw[:_MAX_TEXT].decode("ascii", "replace")
    return "".join(c if c.isprintable() else "?" for c in text)


def _reply(line: bytes) -> Reply:
    try:
        said = msgspec.json.decode(line, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadPacket("reply_not_json") from None
    if len(said) != 1:
        raise BadPacket("reply_content")
    ((key, value),) = said.items()
    return Reply(plain(key), value)
