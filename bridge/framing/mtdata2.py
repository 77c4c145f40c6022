"""Xsens messages on a byte stream, and the data items of MTData2, without I/O. All numbers are big-endian.

    message    FA FF kind length data sum          length FF: two more bytes give the length
    item       identifier[2] length data           the identifier's low nibble is the number format

FA and FF are bytes in hexadecimal. kind, length and sum are one byte each; a length counts the bytes of data. All bytes
of a message but the first add up to 0 modulo 256. After damage, bytes are dropped one at a time until a message is
found. Source: MT Low Level Communication Protocol Documentation, MT0101P.
"""

import math
import struct
from typing import NamedTuple

from bridge.framing.frame_scanner import FrameScanner
from bridge.framing.packets import BadPacket

REQ_DEVICE, GOTO_MEASUREMENT, REQ_FIRMWARE, REQ_PRODUCT = 0x00, 0x10, 0x12, 0x1C
GOTO_CONFIG, MTDATA2, WAKE_UP, WAKE_UP_ACK, ERROR, SET_OUTPUT = 0x30, 0x36, 0x3E, 0x3F, 0x42, 0xC0
TEMPERATURE, PACKET_COUNTER, SAMPLE_TIME = 0x0810, 0x1020, 0x1060
ACCELERATION, RATE_OF_TURN, STATUS = 0x4020, 0x8020, 0xE020
RAW, RAW_GYRO = 0xA010, 0xA020  # counts; the manual gives no sensitivity
DELTA_V, DELTA_Q = 0x4010, 0x8030
MTDATA = 0x32  # message kind of devices older than MTData2
BAD_SUM = "frame_bad_sum"
MAX_DATA = 2048
_HEAD = b"\xfa\xff"
_LONG = 0xFF
_GYRO_CLIPPED = 0x3800  # status bits: x, y, z
_PACKED = {0: ("f", 4), 1: ("i", 4), 3: ("d", 8)}
_FP_12_20, _FP_16_32 = 1, 2


class Message(NamedTuple):
    """Message from or to an Xsens device: number of its kind, and data bytes."""

    kind: int
    data: bytes


class Data(NamedTuple):
    """Content of an MTData2 message that truerate uses; None for an item that the message lacks. Vectors in the sensor frame.

    gyro (3,): rad/s. accel (3,): m/s². celsius: °C. counter: message counter, 16 bits.
    time: device time, 32 bits, in units of 0.1 ms; wraps. gyro_clipped: True if the device reports an axis beyond its
    range. turned (3,): rotation vector of the orientation increment Δq, rad. sped (3,): velocity increment Δv, m/s.
    Both are over the time since the previous message.
    raw: True if the message carries unscaled sensor counts.
    """

    gyro: tuple[float, float, float] | None
    accel: tuple[float, float, float] | None
    celsius: float | None
    counter: int | None
    time: int | None
    gyro_clipped: bool
    turned: tuple[float, float, float] | None = None
    sped: tuple[float, float, float] | None = None
    raw: bool = False


def encode(kind: int, data: bytes = b"") -> bytes:
    """Encode a message to the device, with preamble, length and checksum.

    kind: number of the kind of message. data: at most 254 bytes.
    """
    body = bytes((0xFF, kind, len(data))) + data
    return b"\xfa" + body + bytes((-sum(body) & 0xFF,))


class Messages(FrameScanner):
    """Decoder of Xsens messages: bytes in any chunking in, messages out; memory is bounded.

    faults: number of dropped bytes and damaged messages, by label.
    """

    def feed(self, data: bytes) -> list[Message]:
        """Decode received bytes; return the completed messages, in order."""
        return [Message(frame[2], frame[6 if frame[3] == _LONG else 4 : -1]) for frame, _ in self._frames(data)]

    def _size(self) -> int:
        held = self._bytes
        if not _HEAD.startswith(held[:2]):
            return 0
        if len(held) < 4 or (held[3] == _LONG and len(held) < 6):
            return -1
        begin, length = 4, held[3]
        if length == _LONG:
            begin, length = 6, int.from_bytes(held[4:6], "big")
        size = begin + length + 1
        if length > MAX_DATA:
            return 0
        if len(held) < size:
            return -1
        if sum(held[1:size]) & 0xFF:
            if not self._dropped:  # only where a message was expected: among garbage anything may look like a message
                self.faults.add(BAD_SUM)
            return 0
        return size


def decode(data: bytes) -> Data:
    """Decode the known items in the data of an MTData2 message; items of other kinds are ignored.

    Raises BadPacket if the items do not fill the data exactly, or if an item has a wrong length.
    """
    items: dict[int, tuple[int, bytes]] = {}
    at = 0
    while at < len(data):
        end = at + 3 + data[at + 2] if at + 3 <= len(data) else len(data) + 1
        if end > len(data):
            raise BadPacket("packet_length")
        identifier = int.from_bytes(data[at : at + 2], "big")
        items[identifier & 0xFFF0] = identifier & 0x3, data[at + 3 : end]
        at = end
    celsius = _numbers(items, TEMPERATURE, 1)
    status = _whole(items, STATUS, 4)
    return Data(
        gyro=_vector(_numbers(items, RATE_OF_TURN, 3)),
        accel=_vector(_numbers(items, ACCELERATION, 3)),
        celsius=celsius[0] if celsius else None,
        counter=_whole(items, PACKET_COUNTER, 2),
        time=_whole(items, SAMPLE_TIME, 4),
        gyro_clipped=bool((status or 0) & _GYRO_CLIPPED),
        turned=_rotation(_numbers(items, DELTA_Q, 4)),
        sped=_vector(_numbers(items, DELTA_V, 3)),
        raw=RAW in items or RAW_GYRO in items,
    )


def _rotation(quaternion: list[float]) -> tuple[float, float, float] | None:
    """Rotation vector, rad, of a unit quaternion, scalar first; None for an empty list."""
    if not quaternion:
        return None
    w, *xyz = quaternion if quaternion[0] >= 0 else [-part for part in quaternion]
    sine = math.hypot(*xyz)
    scale = 2 * math.atan2(sine, w) / sine if sine > 0 else 2.0
    return xyz[0] * scale, xyz[1] * scale, xyz[2] * scale


def _vector(numbers: list[float]) -> tuple[float, float, float] | None:
    return (numbers[0], numbers[1], numbers[2]) if numbers else None


def _whole(items: dict[int, tuple[int, bytes]], what: int, size: int) -> int | None:
    if what not in items:
        return None
    _, data = items[what]
    if len(data) != size:
        raise BadPacket("packet_content")
    return int.from_bytes(data, "big")


def _numbers(items: dict[int, tuple[int, bytes]], what: int, n: int) -> list[float]:
    """N numbers of an item, empty if there is no such item; in the 16.32 format the 32 fractional bits come first."""
    if what not in items:
        return []
    form, data = items[what]
    letter, size = _PACKED.get(form, ("", 6))
    if len(data) != n * size:
        raise BadPacket("packet_content")
    if form == _FP_16_32:
        parts = struct.unpack(">" + n * "Ih", data)
        return [whole + part / 2**32 for part, whole in zip(parts[::2], parts[1::2], strict=True)]
    scale = 2.0**-20 if form == _FP_12_20 else 1.0
    return [scale * number for number in struct.unpack(f">{n}{letter}", data)]
