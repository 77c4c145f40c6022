"""Drivers of devices that send bytes: a protocol decoder on top of a transport, each independent of the other."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from msgspec import Struct

from bridge.drivers.driver import DriverKind, Event, Readings
from bridge.transport import address
from bridge.transport.errors import DeviceLost
from bridge.transport.transport import Chunk, Transport
from bridge.wire.refusal import Tally

#: name of the notice that data of the device's protocol carry no rate
OUTPUT = "output"
_UNREAD_CHUNKS, _UNREAD_BYTES = 256, 1024  # limits of the undecoded bytes kept: chunks, bytes of a chunk


class Decoder(Protocol):
    """Interface of a decoder for one device's protocol: bytes in any chunking in, events out. No I/O and no clock.

    One decoder object lives as long as the driver. faults: counts of frames and samples that could not be used, by label.
    """

    faults: Tally

    def opened(self) -> None:
        """Report that the port was opened (again): drop unfinished frames; the device may have rebooted."""

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        data: the bytes. receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        Also called without bytes, so that the decoder notices that time passes.
        """

    def to_send(self) -> bytes:
        """Return the bytes to send to the device now, b"" if there are none. The next call does not return them again."""
        return b""

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder held back, for example for lack of a sample rate."""
        return []


class StreamOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of every device that sends bytes: port, and baud rate of a serial port (ignored by USB devices).

    Raises ValueError for an invalid port or baud rate.
    """

    #: where the device is: `/dev/serial/by-id/usb-...`, `tcp://10.0.0.5:8000`, `udp://:8000?from=10.0.0.5`, `ble://...`
    port: str
    #: speed of a serial port, bits per second, 300 to 4000000; must equal the device's setting. USB devices ignore it
    baud: int = 115_200

    def __post_init__(self) -> None:
        address.check(self.port, self.baud)


class StreamDriver:
    """Driver of one device, composed of a protocol decoder and a transport.

    transport: by default, it is created from port and baud rate in the options.
    bytes_in, samples_in: number of bytes received and of samples decoded since the port was opened.
    """

    def __init__(self, options: StreamOptions, decoder: Decoder, transport: Transport | None = None) -> None:
        self.place = options.port
        self.faults = decoder.faults
        self._transport = transport or address.transport(options.port, options.baud)
        self._transport.faults = decoder.faults
        self._decoder = decoder
        self._unread: deque[Chunk] = deque(maxlen=_UNREAD_CHUNKS)
        self.bytes_in = self.samples_in = 0

    def open(self) -> None:
        """Open the transport and reset the decoder. Raises DeviceUnavailable if the transport cannot be opened now."""
        self._transport.open()
        self._unread.clear()
        self.bytes_in = self.samples_in = 0
        self._decoder.opened()

    def read(self, timeout_s: float) -> list[Event]:
        """Send the decoder's pending bytes, then read; return the events of the received bytes.

        timeout_s: longest wait for the first byte, s. Raises DeviceLost if the device is gone.
        """
        if data := self._decoder.to_send():
            self._transport.write(data)
        try:
            return self._feed(self._transport.read(timeout_s))
        except DeviceLost as lost:
            if lost.over and (rest := self._counted(self._decoder.finish())):
                return rest  # the next call raises DeviceLost
            raise

    def _feed(self, chunk: Chunk) -> list[Event]:
        events = self._counted(self._decoder.feed(chunk.data, chunk.receive_time_ns))
        self.bytes_in += len(chunk.data)
        if events:
            self._unread.clear()
        elif chunk.data:
            self._unread.append(chunk._replace(data=chunk.data[-_UNREAD_BYTES:]))
        return events

    def _counted(self, events: list[Event]) -> list[Event]:
        self.samples_in += sum(len(event.ticks) for event in events if isinstance(event, Readings))
        return events

    def unread(self) -> list[Chunk]:
        """Return the chunks received since the decoder's last event, to show the user what could not be decoded.

        At most the latest 256 chunks are kept, with the last 1024 bytes of each. Call it in the reading thread only.
        """
        return list(self._unread)

    def close(self) -> None:
        """Close the transport; this ends a `read` in another thread."""
        self._transport.close()


def stream_kind(
    name: str,
    summary: str,
    options: type[StreamOptions],
    decoder: Callable[[Any], Decoder],
    *,
    auto: bool = True,
    variants: Callable[[], Sequence[dict[str, Any]]] = lambda: ({},),
) -> DriverKind:
    """Build the DriverKind of a driver that combines a decoder and a transport.

    name, summary, options, variants: as in DriverKind. decoder: creates the decoder from the options.
    auto: True lets `bridge scan` try the decoder on unknown bytes, once per option table in `variants` ({} for no
    options).
    """
    return DriverKind(
        name=name,
        summary=summary,
        options=options,
        make=lambda chosen: StreamDriver(chosen, decoder(chosen)),
        state=lambda chosen: address.state(chosen.port),
        decoder=decoder if auto else None,
        variants=variants,
    )
