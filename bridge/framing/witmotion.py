"""WitMotion frames on a byte stream, without I/O: byte 55, kind, data, and in the serial form a checksum.

    serial       55 kind data[8] sum      sum: of the ten bytes before it, modulo 256
    Bluetooth    55 61 data[18]           acceleration, rate, angle; no checksum
                 55 61 data[26]           the same, with date and time (WT901SDCL-BT50)
                 55 71 data[18]           a register's number, and eight registers from there on

Bytes are in hexadecimal; `[n]` is a size in bytes. A serial frame of kind 50 has the time, 51 the acceleration, 52 the
angular rate, 5F registers. Vectors are x, y, z in signed 16-bit words, little-endian: 32768 stands for 16 g or 2000
°/s. Time is year - 2000, month, day, hour, minute and second in one byte each, then milliseconds in two bytes,
little-endian. A device uses one of the two forms. After damage, bytes are dropped one at a time until a frame is found;
a frame without checksum is then accepted only if another frame follows it. Source: WIT Standard Communication Protocol,
vendor's C SDK.
"""

from typing import NamedTuple

from bridge.framing.frame_scanner import FrameScanner

HEAD = 0x55
TIME, ACCEL, GYRO, REGISTERS = 0x50, 0x51, 0x52, 0x5F
MOTION, MOTION_REGISTERS = 0x61, 0x71
BAD_SUM = "frame_bad_sum"
_CHECKED, _UNCHECKED, _UNCHECKED_TIMED = 11, 20, 28  # bytes
_KINDS = frozenset((*range(TIME, 0x5B), REGISTERS))
_UNCHECKED_KINDS = frozenset((MOTION, MOTION_REGISTERS))


class Frame(NamedTuple):
    """WitMotion frame: number of its kind, and data of 8, 18 or 26 bytes.

    after_fault: True if bytes were dropped before the frame.
    """

    kind: int
    data: bytes
    after_fault: bool


class WitFrames(FrameScanner):
    """Decoder of WitMotion frames: bytes in any chunking in, frames out; memory is bounded.

    faults: number of dropped bytes and damaged frames, by label.
    checked: True if the device uses the serial form with checksums, False for the Bluetooth form, None until known.
    """

    def opened(self) -> None:
        """Drop an unfinished frame and forget the form of frames, because the port was opened, perhaps to another device."""
        super().opened()
        self.checked: bool | None = None
        self._motion_size = _UNCHECKED

    def feed(self, data: bytes) -> list[Frame]:
        """Decode received bytes; return the completed frames, in order."""
        return [
            Frame(frame[1], frame[2:-1] if len(frame) == _CHECKED else frame[2:], dropped > 0)
            for frame, dropped in self._frames(data)
        ]

    def _size(self) -> int:
        held = self._bytes
        if held[0] != HEAD:
            return 0
        if len(held) < 2:
            return -1
        if self.checked is not False and held[1] in _KINDS:
            return self._checked_size()
        if self.checked is not True and held[1] in _UNCHECKED_KINDS:
            return self._unchecked_size(held[1])
        return 0

    def _checked_size(self) -> int:
        held = self._bytes
        if len(held) < _CHECKED:
            return -1
        if sum(held[: _CHECKED - 1]) & 0xFF == held[_CHECKED - 1]:
            self.checked = True
            return _CHECKED
        # only where a frame was expected: among garbage anything may look like a frame
        if not self._dropped and self.checked:
            self.faults.add(BAD_SUM)
        return 0

    def _unchecked_size(self, kind: int) -> int:
        """Size of a frame without checksum, as in `_size`.

        Where a frame is expected, it is accepted unless something else follows; elsewhere, only if another frame
        follows.
        """
        held = self._bytes
        if self.checked is False and not self._dropped:
            size = self._motion_size if kind == MOTION else _UNCHECKED
            if len(held) < size:
                return -1
            return size if len(held) == size or held[size] == HEAD else 0
        for size in (_UNCHECKED, _UNCHECKED_TIMED) if kind == MOTION else (_UNCHECKED,):
            if len(held) < size + 2:
                return -1
            if held[size] == HEAD and held[size + 1] in _UNCHECKED_KINDS:
                self.checked, self._motion_size = False, size if kind == MOTION else self._motion_size
                return size
        return 0
