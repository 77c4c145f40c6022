"""Lines of a byte stream, without I/O: whatever ends with 0x0A, text or not."""

from bridge.wire.refusal import Tally

END = b"\n"
TOO_LONG = "line_too_long"


class Lines:
    """Any chunking of bytes in, whole lines out without their end; what is too long is counted, memory is bounded."""

    def __init__(self, longest: int, faults: Tally) -> None:
        self.faults = faults
        self._longest = longest
        self._partial = b""
        self._overlong = False

    def opened(self) -> None:
        """Forget what was begun."""
        self._partial, self._overlong = b"", False

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes as they came and return the lines they complete, in order; none is empty."""
        *ended, rest = data.split(END)
        lines = []
        for piece in ended:
            self._keep(piece)
            if self._overlong:
                self.faults.add(TOO_LONG)
            elif self._partial:
                lines.append(self._partial)
            self.opened()
        self._keep(rest)
        return lines

    def _keep(self, piece: bytes) -> None:
        if self._overlong or len(self._partial) + len(piece) > self._longest:
            self._partial, self._overlong = b"", True
        else:
            self._partial += piece
