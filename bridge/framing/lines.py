"""Text lines of a byte stream, without I/O: bytes in any chunking in, whole lines out, bounded memory."""

import re
from typing import NamedTuple

LINE_FEED, ANY_END = b"\n", b"\r\n"


class Line(NamedTuple):
    """One line of a byte stream, without the bytes that end it.

    begun: True for the first line after the port was opened; its beginning may be missing. too_long: True if the line
    was cut.
    """

    data: bytes
    begun: bool
    too_long: bool


class Lines:
    """Splits a byte stream into lines at any byte of `ends`; skips empty lines.

    longest: number of bytes at which a line is cut.
    """

    def __init__(self, longest: int, ends: bytes = LINE_FEED) -> None:
        self._longest = longest
        self._end = re.compile(b"[" + ends + b"]")
        self.opened()

    def opened(self) -> None:
        """Drop an unfinished line, because the port was opened (again)."""
        self._partial = bytearray()
        self._too_long = False
        self._begun = True

    def feed(self, data: bytes) -> list[Line]:
        """Decode received bytes; return the completed lines, in order."""
        *ended, rest = self._end.split(data)
        lines = []
        for piece in ended:
            if piece or self._partial:
                self._keep(piece)
                lines.append(Line(bytes(self._partial), self._begun, self._too_long))
                self._partial.clear()
            self._too_long = self._begun = False
        self._keep(rest)
        return lines

    def _keep(self, piece: bytes) -> None:
        room = self._longest - len(self._partial)
        self._too_long |= len(piece) > room
        self._partial += piece[:room]
