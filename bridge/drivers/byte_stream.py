"""Every driver of a device that sends bytes: a decoder of its protocol on a transport, which know nothing of each other."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

from msgspec import Struct

from bridge.drivers.driver import DriverKind, Event, Readings
from bridge.transport import address
from bridge.transport.errors import DeviceLost
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

_UNREAD_CHUNKS, _UNREAD_BYTES = 256, 1024  # and as many of each


class Decoder(Protocol):
    """One device's protocol: any chunking of its bytes in, events out. Without I/O and clock; lives as long as the driver.

    faults: counts what could not be understood, by label.
    """

    faults: Tally

    def opened(self) -> None:
        """The way to the device was opened (again): what was begun is not to be finished, and it may be another boot."""

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """The events these bytes complete, in order; called with none too, so that it can tell that time goes by."""

    def to_send(self) -> bytes:
        """What the device is to be sent now; once."""


@runtime_checkable
class Holds(Protocol):
    """A decoder that holds samples back until it knows more of the device."""

    def finish(self) -> list[Event]:
        """What is held, once nothing more comes, ever."""


class StreamOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the device is, and the speed of a serial port (which USB devices ignore)."""

    port: str
    baud: int = 115_200

    def __post_init__(self) -> None:
        address.check(self.port, self.baud)


class StreamDriver:
    """A decoder behind a transport.

    bytes_in, samples_in: how many came, and were understood, since it was opened.
    """

    def __init__(self, options: StreamOptions, decoder: Decoder) -> None:
        self.place = options.port
        self.faults = decoder.faults
        self._transport = address.transport(options.port, options.baud)
        self._transport.faults = decoder.faults
        self._decoder = decoder
        self._unread: deque[Chunk] = deque(maxlen=_UNREAD_CHUNKS)
        self.bytes_in = self.samples_in = 0

    def open(self) -> None:
        """Open the transport; raises DeviceUnavailable."""
        self._transport.open()
        self._unread.clear()
        self.bytes_in = self.samples_in = 0
        self._decoder.opened()

    def read(self, timeout_s: float) -> list[Event]:
        """What came; raises DeviceLost."""
        if data := self._decoder.to_send():
            self._transport.write(data)
        try:
            return self._feed(self._transport.read(timeout_s))
        except DeviceLost as lost:
            if lost.over and (rest := self._rest()):
                return rest  # the next call says that it is over
            raise

    def _feed(self, chunk: Chunk) -> list[Event]:
        events = self._counted(self._decoder.feed(chunk.data, chunk.receive_time_ns))
        self.bytes_in += len(chunk.data)
        if events:
            self._unread.clear()
        elif chunk.data:
            self._unread.append(chunk._replace(data=chunk.data[-_UNREAD_BYTES:]))
        return events

    def _rest(self) -> list[Event]:
        return self._counted(self._decoder.finish()) if isinstance(self._decoder, Holds) else []

    def _counted(self, events: list[Event]) -> list[Event]:
        self.samples_in += sum(len(event.ticks) for event in events if isinstance(event, Readings))
        return events

    def unread(self) -> list[Chunk]:
        """The latest of what came since the last event: bytes that the decoder makes nothing of. For the reading thread."""
        return list(self._unread)

    def close(self) -> None:
        """Close the transport, ending a read in another thread."""
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
    """The kind of driver that a decoder makes.

    auto: `bridge scan` tries it on bytes of unknown make, with each of the variants of its options, {} being none.
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
