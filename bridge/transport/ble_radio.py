"""Bluetooth Low Energy through bleak and bleak-retry-connector (the extra `ble`); the only file that imports them.

Everything here runs in the thread of `ble_loop`.
"""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final, Protocol

from bridge.reasons.codes import Code, Sentence

if TYPE_CHECKING:
    from bleak import BleakClient

NEEDS: Final = "needs pip install 'truerate[ble]'"
SEARCH_S: Final = 10.0  # for the device's advertisement
_PACKAGES: Final = ("bleak", "bleak_retry_connector")


class RadioFault(Exception):
    """A failed BLE operation, with the code of its reason."""

    def __init__(self, code: Code, **params: object) -> None:
        super().__init__(code)
        self.code, self.params = code, params

    def at(self, place: str) -> Sentence:
        """The reason as a sentence about the device at this place."""
        return self.code(place=place, **self.params)


class Connection(Protocol):
    """A connected BLE device."""

    async def listen(self, characteristic: str, heard: Callable[[bytes], None]) -> None:
        """Call `heard` with each notification of a characteristic, in order; raises RadioFault."""

    async def write(self, characteristic: str, data: bytes) -> None:
        """Send data; raises RadioFault."""

    async def read(self, characteristic: str) -> bytes:
        """Read a characteristic's value; raises RadioFault."""

    async def close(self) -> None:
        """Disconnect; never raises."""


class Radio(Protocol):
    """Maker of BLE connections."""

    async def connect(self, address: str, lost: Callable[[], None]) -> Connection:
        """Connect; `lost` is called when the connection ends for any reason. Raises RadioFault."""


def available() -> bool:
    """Whether the packages of the extra are installed."""
    return all(importlib.util.find_spec(name) is not None for name in _PACKAGES)


class BleakRadio:
    """The machine's own Bluetooth, through BlueZ."""

    async def connect(self, address: str, lost: Callable[[], None]) -> Connection:
        """Connect, after ending a connection that an earlier run left open; raises RadioFault.

        Failures that BlueZ reports as transient are tried again.
        """
        import bleak_retry_connector as retrying  # noqa: PLC0415 - optional extra
        from bleak import BleakScanner  # noqa: PLC0415

        with _told():
            await retrying.close_stale_connections_by_address(address)
            device = await BleakScanner.find_device_by_address(address, timeout=SEARCH_S)
            if device is None:
                raise RadioFault(Code.BLE_NOT_HEARD)
            client = await retrying.establish_connection(
                retrying.BleakClientWithServiceCache, device, address, disconnected_callback=lambda _: lost()
            )
        return _BleakConnection(client)


class _BleakConnection:
    def __init__(self, client: "BleakClient") -> None:
        self._client = client

    async def listen(self, characteristic: str, heard: Callable[[bytes], None]) -> None:
        self._check(characteristic)
        with _told():
            await self._client.start_notify(characteristic, lambda _, data: heard(bytes(data)))

    async def write(self, characteristic: str, data: bytes) -> None:
        self._check(characteristic)
        found = self._client.services.get_characteristic(characteristic)
        assert found is not None
        answered = "write" in found.properties
        piece = len(data) if answered else found.max_write_without_response_size
        with _told():
            for start in range(0, len(data), piece):
                await self._client.write_gatt_char(found, data[start : start + piece], response=answered)

    async def read(self, characteristic: str) -> bytes:
        self._check(characteristic)
        with _told():
            return bytes(await self._client.read_gatt_char(characteristic))

    async def close(self) -> None:
        with contextlib.suppress(RadioFault), _told():
            await self._client.disconnect()

    def _check(self, characteristic: str) -> None:
        there = {each.uuid: each.properties for each in self._client.services.characteristics.values()}
        if characteristic not in there:
            raise no_characteristic(characteristic, there)


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """Turn errors of bleak and the operating system into RadioFault."""
    from bleak.exc import BleakError  # noqa: PLC0415

    try:
        yield
    except (BleakError, OSError, EOFError) as error:
        raise fault(error) from None


def no_characteristic(wanted: str, there: Mapping[str, Sequence[str]]) -> RadioFault:
    """Fault for a device without the configured characteristic, listing those it has."""
    listed = ", ".join(f"{uuid} ({' '.join(properties)})" for uuid, properties in there.items())
    return RadioFault(Code.BLE_NO_CHARACTERISTIC, wanted=wanted, listed=listed or "none")


def fault(error: Exception) -> RadioFault:
    """RadioFault for an error of bleak or the operating system."""
    from bleak.exc import (  # noqa: PLC0415
        BleakBluetoothNotAvailableError,
        BleakBluetoothNotAvailableReason,
        BleakDeviceNotFoundError,
    )
    from bleak_retry_connector import BleakNotFoundError  # noqa: PLC0415

    if isinstance(error, BleakDeviceNotFoundError | BleakNotFoundError | TimeoutError):
        return RadioFault(Code.BLE_NOT_HEARD)
    if isinstance(error, BleakBluetoothNotAvailableError):
        if error.reason is BleakBluetoothNotAvailableReason.POWERED_OFF:
            return RadioFault(Code.BLE_OFF)
        return RadioFault(Code.BLE_UNUSABLE, error=error.args[0])
    if isinstance(error, FileNotFoundError | ConnectionRefusedError):
        return RadioFault(Code.BLE_SERVICE_SILENT)
    return RadioFault(Code.PLACE_FAILED, error=str(error) or type(error).__name__)
