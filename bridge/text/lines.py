"""Lines on a byte stream, without I/O: any chunking in, whole lines out, memory bounded."""

import re
from typing import NamedTuple

MAX_LINE = 1024  # bytes; a logger's header row of many sensors reaches some hundreds
_END = re.compile(rb"[\r\n]")


class Line(NamedTuple):
    """One line without its end. begun: its beginning was not heard, as the port was opened in the midst of it."""

    text: str
    begun: bool
    too_long: bool


class Lines:
    """Ends are CR, LF or both; empty lines are passed over. Of a line that is too long only its beginning is kept."""

    def __init__(self) -> None:
        self.opened()

    def opened(self) -> None:
        """Begin anew: what was begun is dropped, and the next line may be the end of one."""
        self._partial = bytearray()
        self._too_long = False
        self._begun = True

    def feed(self, data: bytes) -> list[Line]:
        """The lines that these bytes end, in order."""
        *ended, rest = _END.split(data)
        lines = []
        for piece in ended:
            self._keep(piece)
            if self._partial:
                text = self._partial.decode("utf-8", "replace").strip()
                lines.append(Line(text, self._begun, self._too_long))
            self._partial.clear()
            self._too_long = self._begun = False
        self._keep(rest)
        return [line for line in lines if line.text]

    def _keep(self, piece: bytes) -> None:
        room = MAX_LINE - len(self._partial)
        self._too_long |= len(piece) > room
        self._partial += piece[:room]
