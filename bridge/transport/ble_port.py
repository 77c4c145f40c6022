"""BLE transport: `ble://address/characteristic[?write=characteristic]`; notified values form a byte stream."""

import asyncio
import contextlib
import re
import threading
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import CancelledError, Future
from typing import Final, NamedTuple

from bridge.reasons.codes import Code
from bridge.transport import ble_loop, ble_radio, url
from bridge.transport.ble_radio import BleakRadio, Connection, Radio, RadioFault
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.inbox import Inbox, joined
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally

EXAMPLE: Final = "ble://C4:64:E3:12:34:56/ffe4?write=ffe9"
OVERFLOW, NOT_SENT = "notifications_overflow", "ble_bytes_not_sent"
_MOST_BYTES = 65_536  # enough for seconds of any device
_ACT_S = 1.0
_PATIENCE_S = 3 * ble_radio.SEARCH_S
_ADDRESS = re.compile(r"[0-9A-F]{2}(:[0-9A-F]{2}){5}")
_UUID = re.compile(r"[0-9a-f]{4}|[0-9a-f]{8}|[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
_BASE = "-0000-1000-8000-00805f9b34fb"  # the rest of Bluetooth's own short identifiers

#: makes the object through which BLE connections are opened; tests replace it
radio: Callable[[], Radio] = BleakRadio


class Place(NamedTuple):
    """Parsed `ble://` address of a device.

    address: Bluetooth address. notify: identifier of the characteristic whose notifications are read.
    write: identifier of the characteristic to write to; empty if nothing is written to the device.
    """

    address: str
    notify: str
    write: str


class BleLink:
    """Transport over one BLE connection; a subclass chooses the characteristics to subscribe to and to write.

    Notifications wait in a bounded inbox. If it is full, the oldest are dropped and counted.
    place: the `ble://` address as shown in messages. address: the device's Bluetooth address.
    Raises ValueError without the packages of the extra `ble`.
    """

    def __init__(self, place: str, address: str) -> None:
        self.place = place
        self.faults = Tally()
        self._address = address
        if not ble_radio.available():
            raise ValueError(f"port {self.place!r} {ble_radio.NEEDS}")
        self._lock = threading.Lock()
        self._inbox: Inbox | None = None
        self._opening: Future[Connection] | None = None
        self._connection: Connection | None = None

    def open(self) -> None:
        """Connect to the device; waits while another device is being connected.

        Raises DeviceUnavailable if the device cannot be connected.
        """
        self.close()
        inbox = Inbox(_MOST_BYTES)
        with self._lock:
            opening = self._opening = ble_loop.run(_connected(self._address, self._listeners(inbox), inbox.end))
            self._inbox = inbox
        try:
            connection = opening.result()
        except RadioFault as fault:
            raise DeviceUnavailable(fault.at(self.place)) from None
        except CancelledError:
            raise DeviceUnavailable(Code.CLOSED(place=self.place)) from None
        with self._lock:
            if self._inbox is inbox:
                self._connection = connection
                return
        ble_loop.run(connection.close())
        raise DeviceUnavailable(Code.CLOSED(place=self.place))

    def read(self, timeout_s: float) -> Chunk:
        """Return the notified values received so far as one chunk; waits at most timeout_s seconds for a first one.

        The chunk has no bytes if none came. Raises DeviceLost once the connection has ended and all values received
        before have been returned.
        """
        inbox = self._inbox
        if inbox is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        heard = inbox.take(timeout_s)
        if lost := inbox.lost():
            self.faults.add(OVERFLOW, lost)
        if not heard and inbox.over:
            raise DeviceLost((Code.CLOSED if self._inbox is not inbox else Code.BLE_LOST)(place=self.place))
        return joined(heard)

    def write(self, data: bytes) -> None:
        """Send data to the device. If the address names no characteristic to write, count the bytes as not sent.

        Raises DeviceLost if the connection has ended, or if sending takes more than a second.
        """
        connection, inbox = self._connection, self._inbox
        if connection is None or inbox is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        sending = self._send(connection, inbox, data)
        if sending is None:
            self.faults.add(NOT_SENT, len(data))
            return
        writing = ble_loop.run(sending)
        try:
            writing.result(_ACT_S)
        except RadioFault as fault:
            raise DeviceLost(fault.at(self.place)) from None
        except (TimeoutError, CancelledError):
            writing.cancel()
            raise DeviceLost(Code.NOT_TAKEN(place=self.place)) from None

    def close(self) -> None:
        """Disconnect from the device; this ends an `open` or a `read` in another thread."""
        with self._lock:
            opening, self._opening = self._opening, None
            inbox, self._inbox = self._inbox, None
            connection, self._connection = self._connection, None
        if opening is not None:
            opening.cancel()
        if inbox is not None:
            inbox.end()
        if connection is not None:
            with contextlib.suppress(TimeoutError, CancelledError):
                ble_loop.run(connection.close()).result(_ACT_S)

    def _listeners(self, inbox: Inbox) -> Mapping[str, Callable[[bytes], None]]:
        """Return the functions that take the notifications, by the identifier of their characteristic."""
        raise NotImplementedError

    def _send(self, connection: Connection, inbox: Inbox, data: bytes) -> Coroutine[None, None, None] | None:
        """Return a coroutine that sends data to the device; None if the address names no characteristic to write to."""
        raise NotImplementedError


class BlePort(BleLink):
    """BLE transport for a device with one characteristic, whose notifications are the bytes read.

    address: the part behind `ble://`. baud: ignored, as BLE has none. Written bytes are sent if the address names a
    characteristic to write to; otherwise they are counted as not sent.
    Raises ValueError for an invalid address, and without the packages of the extra `ble`.
    """

    def __init__(self, address: str, baud: int) -> None:  # noqa: ARG002 - BLE has no baud rate
        self._at = parsed(address)
        super().__init__(f"ble://{address}", self._at.address)

    def _listeners(self, inbox: Inbox) -> Mapping[str, Callable[[bytes], None]]:
        return {self._at.notify: inbox.put}

    def _send(self, connection: Connection, inbox: Inbox, data: bytes) -> Coroutine[None, None, None] | None:  # noqa: ARG002
        return connection.write(self._at.write, data) if self._at.write else None


def parsed(address: str) -> Place:
    """Parse the part of a BLE address behind `ble://`. Raises ValueError, with an example, if it is invalid."""
    where, chosen = url.options(address, ("write",), EXAMPLE)
    device, _, characteristic = where.partition("/")
    return Place(
        device_address(device, EXAMPLE), _uuid(characteristic), _uuid(chosen["write"]) if "write" in chosen else ""
    )


def device_address(text: str, example: str) -> str:
    """Check a Bluetooth address, such as `C4:64:E3:12:34:56`, and return it in upper case.

    example: a valid port, for the error text. Raises ValueError if `text` is not a Bluetooth address.
    """
    if not _ADDRESS.fullmatch(text.upper()):
        raise ValueError(f"{text!r} is not a Bluetooth address: write a port such as {example!r}")
    return text.upper()


def state(address: str) -> str:
    """Return in a few words if a BLE address could be opened, without connecting to the device.

    Whether the device is within reach is not known before connecting. address: the part behind `ble://`. Raises
    ValueError for an invalid address.
    """
    parsed(address)
    return reach()


def reach() -> str:
    """Return in a few words if BLE can be used: `not checked before the port is opened`, or the missing packages."""
    return "not checked before the port is opened" if ble_radio.available() else ble_radio.NEEDS


def _uuid(text: str) -> str:
    uuid = text.lower()
    if not _UUID.fullmatch(uuid):
        raise ValueError(
            f"{text!r} is not a characteristic of 4 or 32 hexadecimal digits: write a port such as {EXAMPLE!r}"
        )
    return uuid if "-" in uuid else uuid.rjust(8, "0") + _BASE


async def _connected(
    address: str, listeners: Mapping[str, Callable[[bytes], None]], lost: Callable[[], None]
) -> Connection:
    """Connect and listen, one device at a time; gives up after _PATIENCE_S, so that other devices get their turn."""
    async with ble_loop.connecting:
        try:
            async with asyncio.timeout(_PATIENCE_S):
                connection = await radio().connect(address, lost)
                try:
                    for characteristic, heard in listeners.items():
                        await connection.listen(characteristic, heard)
                except BaseException:  # also if cancelled: BlueZ would keep the connection
                    await connection.close()
                    raise
                return connection
        except TimeoutError:
            raise RadioFault(Code.BLE_NO_CONNECTION, duration_s=f"{_PATIENCE_S:g}") from None
