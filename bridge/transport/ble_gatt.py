"""BLE transport for a device with several characteristics: a codec frames each value in one byte stream."""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from bridge.transport.ble_port import BleLink, device_address
from bridge.transport.ble_radio import Connection
from bridge.transport.inbox import Inbox


class Codec(NamedTuple):
    """Pair of functions that convert values of BLE characteristics to frames of a byte stream, and back.

    encode(number, value): returns the frame of one value; number identifies the characteristic.
    decode(frames): returns pairs (number, value). A pair with an empty value requests to read that characteristic.
    """

    encode: Callable[[int, bytes], bytes]
    decode: Callable[[bytes], Sequence[tuple[int, bytes]]]


class GattPort(BleLink):
    """BLE transport for a device with several characteristics; the bytes read and written are frames of a codec.

    port: `ble://address`. example: a valid port, for error messages. uuid(number): returns the full identifier of a
    characteristic. notify: numbers of the characteristics whose notifications are read. codec: converts values of
    characteristics to frames, and back.
    Raises ValueError for an invalid port, and without the packages of the extra `ble`.
    """

    def __init__(
        self, port: str, example: str, uuid: Callable[[int], str], notify: Sequence[int], codec: Codec
    ) -> None:
        super().__init__(port, device_address(port.removeprefix("ble://"), example))
        self._uuid, self._notify, self._codec = uuid, notify, codec

    def _listeners(self, inbox: Inbox) -> Mapping[str, Callable[[bytes], None]]:
        return {self._uuid(number): partial(self._put, inbox, number) for number in self._notify}

    def _send(self, connection: Connection, inbox: Inbox, data: bytes) -> Coroutine[None, None, None]:
        return self._exchange(connection, inbox, self._codec.decode(data))

    async def _exchange(self, connection: Connection, inbox: Inbox, values: Sequence[tuple[int, bytes]]) -> None:
        for number, value in values:
            if value:
                await connection.write(self._uuid(number), value)
            else:
                self._put(inbox, number, await connection.read(self._uuid(number)))

    def _put(self, inbox: Inbox, number: int, value: bytes) -> None:
        inbox.put(self._codec.encode(number, value))
