"""COBS frames on a byte stream, without I/O: each frame ends with a CRC-32 checksum and a zero byte.

    frame = COBS(payload + crc32(payload) little-endian) + 0x00

COBS (consistent overhead byte stuffing) removes zero bytes from the content. A zero byte always ends a frame, so the
next frame is found again after any damage.
"""

import zlib

from cobs import cobs

from bridge.wire.refusal import Tally

MAX_PAYLOAD = 1024
_CRC_BYTES = 4
_CRC_OF_WHOLE = 0x2144DF1C  # CRC-32 of any data followed by its own CRC-32
# COBS adds one byte, plus one for every 254.
_MAX_FRAME = MAX_PAYLOAD + _CRC_BYTES + 2 + (MAX_PAYLOAD + _CRC_BYTES) // 254


def frame(payload: bytes) -> bytes:
    """Encode a payload of 1 to MAX_PAYLOAD bytes as a COBS frame with CRC-32 and final zero byte.

    Raises ValueError for other lengths.
    """
    if not 1 <= len(payload) <= MAX_PAYLOAD:
        raise ValueError(f"the payload has {len(payload)} bytes: give 1 to {MAX_PAYLOAD}")
    crc = zlib.crc32(payload).to_bytes(_CRC_BYTES, "little")
    return bytes(cobs.encode(payload + crc)) + b"\0"


class Deframer:
    """Decoder of COBS frames: bytes in any chunking in, whole payloads out; memory is bounded.

    faults: number of damaged frames, by label.
    """

    def __init__(self) -> None:
        self.faults = Tally()
        self._partial = b""  # of an overlong frame, one byte more than allowed is kept, to recognise it

    def feed(self, data: bytes) -> list[bytes]:
        """Decode received bytes; return the payloads of the completed frames, in order."""
        *ended, rest = data.split(b"\0")
        payloads = []
        for piece in ended:
            body, self._partial = self._partial + piece, b""
            # Two zeros in a row are an idle line, not a fault.
            if body and (payload := self._payload(body)) is not None:
                payloads.append(payload)
        self._partial = (self._partial + rest)[: _MAX_FRAME + 1]
        return payloads

    def _payload(self, body: bytes) -> bytes | None:
        if len(body) > _MAX_FRAME:
            self.faults.add("frame_too_long")
            return None
        try:
            content: bytes = cobs.decode(body)
        except cobs.DecodeError:
            self.faults.add("frame_not_cobs")
            return None
        payload = content[:-_CRC_BYTES]
        if not payload:
            self.faults.add("frame_too_short")
            return None
        if zlib.crc32(content) != _CRC_OF_WHOLE:
            self.faults.add("frame_bad_crc")
            return None
        return payload
