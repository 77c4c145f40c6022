"""Frame scanner, without I/O: finds frames that may begin at any byte of a stream. Base of several protocols' decoders.

After damage, bytes are dropped one at a time and counted, until a frame is found.
"""

from collections.abc import Iterator

from bridge.wire.refusal import Tally

GARBAGE = "bytes_between_frames"


class FrameScanner:
    """Splits a byte stream into frames: bytes in any chunking in, whole frames out; memory is bounded.

    faults: number of dropped bytes and damaged frames, by label. A subclass implements `_size`, which returns the size in
    bytes of the frame at the beginning of the held bytes.
    """

    def __init__(self, faults: Tally) -> None:
        self.faults = faults
        self.opened()

    def opened(self) -> None:
        """Drop an unfinished frame, because the port was opened (again)."""
        self._bytes = bytearray()
        self._dropped = 0  # bytes dropped since the last frame

    def _frames(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Add received bytes; yield each frame that they complete, and the number of bytes dropped before it."""
        self._bytes += data
        while self._bytes and (size := self._size()) >= 0:
            if not size:
                del self._bytes[0]
                self._dropped += 1
                continue
            frame, dropped = bytes(self._bytes[:size]), self._dropped
            del self._bytes[:size]
            self._dropped = 0
            if dropped:
                self.faults.add(GARBAGE, dropped)
            yield frame, dropped

    def _size(self) -> int:
        """Size in bytes of the frame at the beginning of the held bytes; 0 if there is none, -1 if not known yet."""
        raise NotImplementedError
