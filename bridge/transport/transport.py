"""Transport interface: a serial port, a network connection or a file that carries a device's bytes."""

from typing import NamedTuple, Protocol

from bridge.wire.refusal import Tally


class Chunk(NamedTuple):
    """Bytes received from a device.

    receive_time_ns: receive time of the last byte, ns since the Unix epoch, by `host_time.now_ns`.
    """

    data: bytes
    receive_time_ns: int


class Transport(Protocol):
    """Interface of a connection that carries the bytes of one device; it can be reopened after a close or a loss.

    place: the address as shown in messages. faults: counts of dropped data by label; the driver of the device may
    replace this attribute by its own counts. Call `read` and `write` from one thread, `close` from any.
    """

    place: str
    faults: Tally

    def open(self) -> None:
        """Open the connection. Raises DeviceUnavailable, which states the cause and what to do."""

    def read(self, timeout_s: float) -> Chunk:
        """Return received bytes, up to about 64 kB, with their receive time; waits at most timeout_s seconds for the first.

        The chunk has no bytes if none came. Raises DeviceLost if the device is gone.
        """

    def write(self, data: bytes) -> None:
        """Send data to the device.

        Raises DeviceLost if the device is gone, or does not accept the data within a second.
        """

    def close(self) -> None:
        """Close the connection; this ends a `read` in another thread. Never raises, and may be repeated."""
