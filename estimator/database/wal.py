"""What is in SQLite's write-ahead log, read by its own checksums (sqlite.org/fileformat2.html, section 4).

SQLite takes the frames up to the first bad one and says nothing of those behind it. Pure: bytes in, pages and counts out.
"""

import struct
from array import array
from dataclasses import dataclass, field

_HEADER, _FRAME = 32, 24
_MAGIC = 0x377F0682  # the lowest bit: checksums over big-endian words
_MASK = 0xFFFFFFFF
_BIG_HOST = struct.pack("=H", 1) == b"\x00\x01"


@dataclass(frozen=True, slots=True)
class Log:
    """Frames written since the log was begun, how many of them, from the first on, are whole, and the committed pages."""

    given: int = 0
    whole: int = 0
    page_size: int = 0
    pages: dict[int, bytes] = field(default_factory=dict)

    @property
    def lost(self) -> int:
        """Frames that SQLite passes over in silence."""
        return self.given - self.whole

    def onto(self, file: bytes, end: int | None = None) -> bytes:
        """The database file, or its beginning up to a byte, with these pages in it."""
        whole = bytearray(file)
        for number, page in self.pages.items():
            at = (number - 1) * self.page_size
            if end is not None and at >= end:
                continue
            whole.extend(bytes(max(0, at + self.page_size - len(whole))))
            whole[at : at + self.page_size] = page
        return bytes(whole[:end])


def read(log: bytes) -> Log:
    """Look at a whole log file; a header that is not whole makes all of it unreadable."""
    if len(log) < _HEADER:
        return Log(given=1 if log else 0)
    magic, _, size, _, *salts, first, second = struct.unpack(">8I", log[:_HEADER])
    big = bool(magic & 1)
    if magic & ~1 != _MAGIC or not 512 <= size <= 65536 or _sum(log[: _HEADER - 8], (0, 0), big=big) != (first, second):
        return Log(given=1)
    given = whole = 0
    sums, pages, open_pages = (first, second), dict[int, bytes](), dict[int, bytes]()
    for number, at in enumerate(range(_HEADER, len(log) - _FRAME - size + 1, _FRAME + size)):
        head, page = log[at : at + _FRAME], log[at + _FRAME : at + _FRAME + size]
        of_this_log = list(struct.unpack(">2I", head[8:16])) == salts
        if whole == number:
            sums = _sum(page, _sum(head[:8], sums, big=big), big=big)
            whole_too = sums == struct.unpack(">2I", head[16:])
            # A frame with other salts is what an earlier log left, unless it follows on all the same.
            given = number + 1 if of_this_log or whole_too else given
            if of_this_log and whole_too:
                whole = number + 1
                place, commit = struct.unpack(">2I", head[:8])
                open_pages[place] = page
                if commit:
                    pages |= open_pages
                    open_pages = {}
        elif of_this_log:
            given = number + 1
    return Log(given, whole, size, pages)


def _sum(data: bytes, sums: tuple[int, int], *, big: bool) -> tuple[int, int]:
    words = array("I", data)
    if big != _BIG_HOST:
        words.byteswap()
    s0, s1 = sums
    pairs = iter(words)
    for x0, x1 in zip(pairs, pairs, strict=True):
        s0 = (s0 + x0 + s1) & _MASK
        s1 = (s1 + x1 + s0) & _MASK
    return s0, s1
