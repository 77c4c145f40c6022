"""Transport contract: a serial port, a network connection or a file that carries a device's bytes."""

from typing import NamedTuple, Protocol

from bridge.wire.refusal import Tally


class Chunk(NamedTuple):
    """Received bytes with their receive time: that of the last byte, by `host_time.now_ns`, ns since the Unix epoch."""

    data: bytes
    receive_time_ns: int


class Transport(Protocol):
    """Contract of a connection that carries the bytes of one device; it can be reopened after a close or a loss.

    place: the address, for messages. faults: counts of dropped data by label; the driver of the device may replace this
    attribute by its own tally. Call `read` and `write` from one thread, `close` from any.
    """

    place: str
    faults: Tally

    def open(self) -> None:
        """Open the connection; raises DeviceUnavailable with the cause and what to do."""

    def read(self, timeout_s: float) -> Chunk:
        """Return received bytes, up to about 64 kB, waiting at most timeout_s for the first; empty if none.

        Raises DeviceLost if the device has gone.
        """

    def write(self, data: bytes) -> None:
        """Send data to the device.

        Raises DeviceLost if the device has gone, or does not accept the data within a second.
        """

    def close(self) -> None:
        """Close the connection; this ends a read in another thread. Never raises, and may be repeated."""
