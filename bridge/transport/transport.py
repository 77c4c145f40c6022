"""The transport contract: a serial port, a network connection or a file that carries a device's bytes."""

from typing import NamedTuple, Protocol

from bridge.wire.refusal import Tally


class Chunk(NamedTuple):
    """Received bytes, and the host time (`host_time.now_ns`, ns) right after the last byte was received."""

    data: bytes
    receive_time_ns: int


class Transport(Protocol):
    """Connection that carries the bytes of one device. It can be reopened after a close or a loss.

    place: the address, for people. faults: counts dropped data by label; a driver replaces it with its own tally.
    Call read and write from one thread, close from any.
    """

    place: str
    faults: Tally

    def open(self) -> None:
        """Open the connection; raises DeviceUnavailable with the cause and what to do."""

    def read(self, timeout_s: float) -> Chunk:
        """Return received bytes, up to some 64 kB, waiting at most timeout_s for the first; empty if none.

        Raises DeviceLost if the device has gone.
        """

    def write(self, data: bytes) -> None:
        """Send data to the device; raises DeviceLost if the device has gone, or does not accept them within a second."""

    def close(self) -> None:
        """Close the connection; this ends a read in another thread. Never raises, and may be repeated."""
