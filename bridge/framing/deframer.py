"""Frames on a byte stream, without I/O: COBS between zero bytes, with a CRC-32 at the end of each.

    frame = COBS(payload + crc32(payload) little-endian) + 0x00

A zero byte always ends a frame, so after any damage the next frame is found again.
"""

import zlib

from cobs import cobs

from bridge.wire.refusal import Tally

MAX_PAYLOAD = 1024
_CRC_BYTES = 4
# COBS adds one byte, and one more for every 254.
_MAX_FRAME = MAX_PAYLOAD + _CRC_BYTES + 2 + (MAX_PAYLOAD + _CRC_BYTES) // 254


def frame(payload: bytes) -> bytes:
    """The bytes to send for a payload of 1 to MAX_PAYLOAD bytes; ValueError outside that."""
    if not 1 <= len(payload) <= MAX_PAYLOAD:
        raise ValueError(f"a payload has 1 to {MAX_PAYLOAD} bytes, not {len(payload)}")
    crc = zlib.crc32(payload).to_bytes(_CRC_BYTES, "little")
    return bytes(cobs.encode(payload + crc)) + b"\0"


class Deframer:
    """Any chunking of bytes in, whole payloads out; faults are counted in `faults`, memory is bounded."""

    def __init__(self) -> None:
        self.faults = Tally()
        self._partial = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes as they came and return the payloads they complete, in order."""
        *ended, rest = data.split(b"\0")
        payloads = []
        for piece in ended:
            self._keep(piece)
            payload = self._finish()
            if payload is not None:
                payloads.append(payload)
        self._keep(rest)
        return payloads

    def _keep(self, piece: bytes) -> None:
        if self._overlong:
            return
        if len(self._partial) + len(piece) > _MAX_FRAME:
            self._overlong = True
            self._partial.clear()
        else:
            self._partial += piece

    def _finish(self) -> bytes | None:
        body, overlong = bytes(self._partial), self._overlong
        self._partial.clear()
        self._overlong = False
        if overlong:
            self.faults.add("frame_too_long")
            return None
        if not body:
            return None  # two zeros in a row: an idle line, not a fault
        try:
            content: bytes = cobs.decode(body)
        except cobs.DecodeError:
            self.faults.add("frame_not_cobs")
            return None
        payload, crc = content[:-_CRC_BYTES], content[-_CRC_BYTES:]
        if not payload:
            self.faults.add("frame_too_short")
            return None
        if zlib.crc32(payload).to_bytes(_CRC_BYTES, "little") != crc:
            self.faults.add("frame_bad_crc")
            return None
        return payload
