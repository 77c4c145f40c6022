"""Reader of a text file in blocks of whole lines: plain or gzip, UTF-8 or UTF-16, with or without byte order mark."""

import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from bridge.recording.error import RecordingError
from bridge.runtime.os_errors import why

#: limit of a text: `correct` writes 3 GB for a day at 100 Hz; unused columns cost no memory
MAX_TEXT_BYTES = 1 << 32
#: most characters of a line; characters read at once
MAX_LINE = 1 << 22
BLOCK = 1 << 20
_SNIFFED = 4096
_CONTROL = frozenset({*range(9), *range(14, 32)})
_BINARY = 0.02


def blocks(path: Path) -> Iterator[list[str]]:
    """Yield the lines of a text file, without line ends, in lists of some thousands.

    Gzip and UTF-16 are recognised. Raises RecordingError for a file that is unreadable, binary or too large, and for
    too long a line.
    """
    rest, size = "", 0
    with _opened(path) as raw:
        text = io.TextIOWrapper(raw, encoding=_encoding(path, raw), errors="replace", newline=None)
        while block := text.read(BLOCK):
            size += len(block)
            if size > MAX_TEXT_BYTES:
                raise RecordingError(
                    f"{path}: the file has more than {MAX_TEXT_BYTES >> 20} MB of text: split the file"
                )
            lines = (rest + block.replace("\0", "")).split("\n")
            rest = lines.pop()
            if len(rest) > MAX_LINE:
                raise RecordingError(f"{path}: a line has more than {MAX_LINE} characters: give one row per sample")
            yield lines
        if rest:
            yield [rest]


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    try:
        with path.open("rb") as file:
            packed = file.peek(2)[:2] == b"\x1f\x8b"
            if not packed:
                yield file
                return
            with gzip.open(file) as unpacked, io.BufferedReader(unpacked) as buffered:
                yield buffered
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise RecordingError(
            f"{path}: damaged .gz file: {error}; unpack the readable part with gzip -dc {path} > OUT.csv"
        ) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None


def _encoding(path: Path, raw: IO[bytes]) -> str:
    start: bytes = raw.peek(_SNIFFED)[:_SNIFFED]  # type: ignore[attr-defined]
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    even, odd = start[::2].count(0), start[1::2].count(0)
    if max(even, odd) > 0.4 * len(start) / 2 and min(even, odd) == 0:
        return "utf-16-be" if even > odd else "utf-16-le"
    text = start.rstrip(b"\0")
    if sum(byte in _CONTROL for byte in text) > _BINARY * len(text):
        raise RecordingError(
            f"{path}: binary data, not text. If a device sent it: truerate recording convert {path} OUT.npz --driver NAME "
            "(truerate bridge scan --port file://FILE finds the driver)"
        )
    return "utf-8-sig"
