"""BLE transport of several characteristics: each value is a frame (`bridge.framing.cobs_frames`), so that bytes stay bytes.

    payload of a frame = number of the characteristic, 16 bits, little-endian; value

From the device come notifications and answers. To the device, a value is written; a frame without a value reads the
characteristic. The frames can be captured in a file, and decoded from any point on.
"""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from functools import partial

from bridge.framing.cobs_frames import Deframer, frame
from bridge.transport.ble_port import BleLink, Inbox, device_address
from bridge.transport.ble_radio import Connection

NUMBER_BYTES = 2


def gatt_frame(number: int, value: bytes = b"") -> bytes:
    """Encode a value of a characteristic; without a value, the request to read the characteristic."""
    return frame(number.to_bytes(NUMBER_BYTES, "little") + value)


class GattPort(BleLink):
    """A device's characteristics. port: `ble://address`. uuid: full identifier of a number. notify: numbers to listen to."""

    def __init__(self, port: str, example: str, uuid: Callable[[int], str], notify: Sequence[int]) -> None:
        super().__init__(port, device_address(port.removeprefix("ble://"), example))
        self._uuid, self._notify = uuid, notify

    def _listeners(self, inbox: Inbox) -> Mapping[str, Callable[[bytes], None]]:
        return {self._uuid(number): partial(_put, inbox, number) for number in self._notify}

    def _send(self, connection: Connection, inbox: Inbox, data: bytes) -> Coroutine[None, None, None]:
        return self._exchange(connection, inbox, Deframer().feed(data))

    async def _exchange(self, connection: Connection, inbox: Inbox, payloads: Sequence[bytes]) -> None:
        for payload in payloads:
            number, value = int.from_bytes(payload[:NUMBER_BYTES], "little"), payload[NUMBER_BYTES:]
            if value:
                await connection.write(self._uuid(number), value)
            else:
                _put(inbox, number, await connection.read(self._uuid(number)))


def _put(inbox: Inbox, number: int, value: bytes) -> None:
    inbox.put(gatt_frame(number, value))
