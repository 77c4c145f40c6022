"""What carries a device's bytes: a serial port, a network connection, a file. A driver knows no more of it than this."""

from typing import NamedTuple, Protocol

from bridge.wire.refusal import Tally


class Chunk(NamedTuple):
    """Bytes, and the host time (host_time.py) right after the last of them came."""

    data: bytes
    receive_time_ns: int


class Transport(Protocol):
    """One way to one device. It can be opened again after a close or a loss.

    place: where it leads, for people. faults: counts what it had to drop, by label; a driver gives it its own tally.
    read and write are called from one thread, close from any.
    """

    place: str
    faults: Tally

    def open(self) -> None:
        """Open; raises DeviceUnavailable with the cause and what to do."""

    def read(self, timeout_s: float) -> Chunk:
        """All that came, up to some 64 kB, waiting at most timeout_s for a first byte; empty if none. Raises DeviceLost."""

    def write(self, data: bytes) -> None:
        """Send; raises DeviceLost, also when the device does not take it within a second."""

    def close(self) -> None:
        """Close, ending a read in another thread; never raises, a second close does nothing."""
