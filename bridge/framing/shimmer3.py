"""Answers and data packets of a Shimmer3 on a byte stream, without I/O.

    FF                     acknowledgement of a command          FE    refusal of a command
    FF kind data           the answer to a query
    FF 8A kind data        an answer between data packets; sent without FF if the device was not asked
    00 time[3] channels    a data packet: device time, then one value per channel

The table shows bytes in hexadecimal; kind is one byte. time has three bytes, little-endian, in ticks of 1/32768 s, and
wraps at 2**24 ticks. The device's answer to an inquiry (kind 02) lists the channels and their order.
No byte marks the beginning of a frame. With the CRC turned on, each frame ends with a CRC of two bytes, and is accepted
only if the CRC is right. Without CRC, a data packet is accepted only if another follows whose time fits the sampling
period.
After damage, bytes are dropped one at a time until a frame is found.
Source: Shimmer3 Bluetooth communication protocol, LogAndStream firmware.
"""

import binascii
from collections.abc import Iterator
from typing import NamedTuple

from bridge.framing.frame_scanner import FrameScanner
from bridge.wire.refusal import Tally

DATA, ACK, NACK, IN_STREAM = 0x00, 0xFF, 0xFE, 0x8A
INQUIRY, VERSION, CALIBRATION, FIRMWARE, GYRO_RANGE, STATUS, BATTERY = 0x02, 0x25, 0x2D, 0x2F, 0x4A, 0x71, 0x94
BAD_SUM = "frame_bad_sum"
TIME_BITS, TICKS_A_S = 24, 32_768
_SIZES = {VERSION: 1, CALIBRATION: 84, FIRMWARE: 6, GYRO_RANGE: 1}
_IN_STREAM_SIZES = {STATUS: 1, BATTERY: 3}
_INQUIRY_HEAD = 8  # bytes, the seventh is the number of channels
_SEED = 0xB0CA
_HEAD = 4  # bytes of a data packet before its channels
_LONGEST_GAP = 2 * TICKS_A_S
_JITTER = 8  # part of a period


def crc(frame: bytes) -> bytes:
    """Return a frame's CRC-16/CCITT (start value 0xB0CA) as two bytes, little-endian.

    For a frame with an odd number of bytes, a zero byte is appended before the computation.
    """
    return binascii.crc_hqx(frame + bytes(len(frame) % 2), _SEED).to_bytes(2, "little")


_ACK_AND_CRC = bytes((ACK,)) + crc(bytes((ACK,)))


class Frame(NamedTuple):
    """Frame from a Shimmer3: kind (ACK, NACK, DATA or the kind of an answer), and the data bytes that follow it."""

    kind: int
    data: bytes


class _Shape(NamedTuple):
    kind: int
    head: int  # bytes before the data
    size: int  # bytes of data


class ShimmerFrames(FrameScanner):
    """Decoder of Shimmer3 frames: bytes in any chunking in, frames out; memory is bounded.

    faults: number of dropped bytes and damaged frames, by label.
    checked: True if the frames carry a CRC, as detected by the first acknowledgement with a CRC.
    packet: size of a data packet in bytes, 0 while unknown. period: time between data packets, in ticks of 1/32768 s.
    awaiting_ack: True if the next FF is an acknowledgement, not the beginning of an answer.
    """

    def __init__(self, faults: Tally) -> None:
        self.packet, self.period = 0, 1
        super().__init__(faults)

    def opened(self) -> None:
        """Drop an unfinished frame, because the port was opened (again). A new connection begins without CRC."""
        super().opened()
        self.checked = self.awaiting_ack = False

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Decode received bytes; yield the completed frames, in order.

        The caller may set packet, period and awaiting_ack between two frames.
        """
        for frame, _ in self._frames(data):
            shape = self._shape
            yield Frame(shape.kind, frame[shape.head : shape.head + shape.size])

    def _size(self) -> int:
        held = self._bytes
        if not self.checked and held[0] == ACK:
            if len(held) < len(_ACK_AND_CRC) and _ACK_AND_CRC.startswith(held):
                if not self.awaiting_ack or len(held) > 1:
                    return -1
            elif held.startswith(_ACK_AND_CRC):
                self.checked = True
        wait = False
        for shape in self._shapes():
            if shape is None:
                wait = True
                continue
            end = shape.head + shape.size
            fits = self._sum_fits(end) if self.checked else self._looks_right(shape, end)
            if fits:
                self._shape = shape
                return end + 2 * self.checked
            wait |= fits is None
        if wait:
            return -1
        if not self._dropped and self.checked and held[0] == DATA:
            self.faults.add(BAD_SUM)
        return 0

    def _shapes(self) -> Iterator[_Shape | None]:
        """The frames that may begin here; None where the next bytes have to tell."""
        held = self._bytes
        match held[0]:
            case 0x00:
                if self.packet:
                    yield _Shape(DATA, 1, self.packet - 1)
            case 0xFE:
                yield _Shape(NACK, 1, 0)
            case 0xFF:
                if self.checked or self.awaiting_ack or (len(held) > 1 and held[1] in (DATA, ACK, NACK)):
                    yield _Shape(ACK, 1, 0)
                yield from self._answers(1)
            case 0x8A:
                yield from self._answers(0)

    def _answers(self, at: int) -> Iterator[_Shape | None]:
        held = self._bytes
        if len(held) <= at:
            yield None
        elif held[at] == IN_STREAM:
            if len(held) == at + 1:
                yield None
            elif held[at + 1] in _IN_STREAM_SIZES:
                yield _Shape(held[at + 1], at + 2, _IN_STREAM_SIZES[held[at + 1]])
        elif held[at] == INQUIRY and at:
            channels = at + _INQUIRY_HEAD - 1
            yield _Shape(INQUIRY, at + 1, _INQUIRY_HEAD + held[channels]) if len(held) > channels else None
        elif held[at] in _SIZES and at:
            yield _Shape(held[at], at + 1, _SIZES[held[at]])

    def _sum_fits(self, end: int) -> bool | None:
        """Return whether the CRC of the first `end` bytes follows; None if it is not complete yet."""
        held = self._bytes
        return None if len(held) < end + 2 else crc(bytes(held[:end])) == held[end : end + 2]

    def _looks_right(self, shape: _Shape, end: int) -> bool | None:
        """Return whether a frame without CRC is complete; None if unknown.

        A data packet also needs a packet in time after it.
        """
        held = self._bytes
        if shape.kind != DATA:
            if self._dropped and not (self.awaiting_ack and shape.kind == ACK):
                return False  # among garbage anything may look like an answer
            return True if len(held) >= end else None
        if len(held) <= end:
            return None
        if held[end] != DATA:  # perhaps an answer between two data packets
            news = held[end + (held[end] == ACK) :][:2]
            if len(news) < 2:
                return None
            return not self._dropped and news[0] == IN_STREAM and news[1] in _IN_STREAM_SIZES
        if len(held) < end + _HEAD:
            return None
        first, second = (int.from_bytes(held[at + 1 : at + _HEAD], "little") for at in (0, end))
        step = (second - first) % (1 << TIME_BITS)
        periods = round(step / self.period)
        return 0 < step <= _LONGEST_GAP and periods > 0 and abs(step - periods * self.period) * _JITTER <= self.period
