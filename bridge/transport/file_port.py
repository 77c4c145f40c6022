"""File transport, which plays a capture of a device's bytes as a port: `file:///path?bytes_per_s=...`."""

import threading
import time
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

from bridge.reasons.codes import Code
from bridge.runtime import os_errors
from bridge.transport import host_time, url
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

EXAMPLE = "file:///var/captures/wrist.bin"
_TURN_S = 0.01
_FEWEST_BYTES, _MOST_BYTES = 4096, 1 << 20  # limits of the bytes due at once
_BITS_A_BYTE = 10  # on a serial line: a start bit, eight data bits, a stop bit


class FilePort:
    """File transport, which plays a file's bytes at the pace of a serial line.

    address: the part behind `file://`; its option bytes_per_s sets the pace. baud: bits per second of the serial line,
    used if the address lacks this option. Written bytes are discarded.
    """

    def __init__(self, address: str, baud: int) -> None:
        self.place = f"file://{address}"
        self.faults = Tally()
        self._path, bytes_per_s = parsed(address)
        self._bytes_per_s = bytes_per_s or baud / _BITS_A_BYTE
        self._most = min(max(2 * _TURN_S * self._bytes_per_s, _FEWEST_BYTES), _MOST_BYTES)
        self._file: BinaryIO | None = None
        self._closed = threading.Event()

    def open(self) -> None:
        """Open the file and play it from its beginning. Raises DeviceUnavailable if the file cannot be read."""
        self.close()
        if (said := _state(self._path)) != "present":
            raise DeviceUnavailable(Code.PLACE_FAILED(place=self.place, error=said))
        try:
            self._file = self._path.open("rb")
        except OSError as error:
            raise DeviceUnavailable(Code.PLACE_FAILED(place=self.place, error=os_errors.why(error))) from None
        self._closed.clear()
        self._due, self._then_s = 0.0, time.monotonic()

    def read(self, timeout_s: float) -> Chunk:
        """Return the bytes that a serial line would have delivered since the previous call, with their receive time.

        Waits first for 10 ms, or for timeout_s seconds if this is shorter. Raises DeviceLost at the end of the file
        (with over=True), and if the file is closed or cannot be read.
        """
        self._closed.wait(min(timeout_s, _TURN_S))
        now_s = time.monotonic()
        self._due = min(self._due + (now_s - self._then_s) * self._bytes_per_s, self._most)
        self._then_s = now_s
        most = int(self._due)
        try:
            if self._file is None:
                raise DeviceLost(Code.CLOSED(place=self.place))
            data = self._file.read(most)
        except (OSError, ValueError) as error:  # ValueError: another thread closed the file
            if self._closed.is_set():
                raise DeviceLost(Code.CLOSED(place=self.place)) from None
            raise DeviceLost(Code.PLACE_FAILED(place=self.place, error=error)) from None
        if most and not data:
            raise DeviceLost(Code.CAPTURE_OVER(place=self.place), over=True)
        self._due -= len(data)
        return Chunk(data, host_time.now_ns())

    def write(self, data: bytes) -> None:
        """Discard the data: a file has no receiver."""

    def close(self) -> None:
        """Close the file; this ends a `read` in another thread."""
        self._closed.set()
        opened, self._file = self._file, None
        if opened is not None:
            opened.close()


def parsed(address: str) -> tuple[Path, float]:
    """Parse the part of a file address behind `file://`; return (path, pace in bytes per second, 0 if not given).

    Raises ValueError if the address is invalid.
    """
    path, chosen = url.options(address, ("bytes_per_s",), EXAMPLE)
    if not path or "\0" in unquote(path):
        raise ValueError(f"{address!r} names no file: write for example {EXAMPLE!r}")
    pace = url.number(chosen["bytes_per_s"], "bytes_per_s", 1, 1e9) if "bytes_per_s" in chosen else 0.0
    return Path(unquote(path)), pace


def state(address: str) -> str:
    """Return `present` if the file of an address can be read, else the cause in a few words.

    address: the part behind `file://`. Raises ValueError for an invalid address.
    """
    return _state(parsed(address)[0])


def _state(path: Path) -> str:
    return os_errors.unreadable(path) or "present"
