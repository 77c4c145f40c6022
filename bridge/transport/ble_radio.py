"""Connections to Bluetooth Low Energy devices, by bleak and bleak-retry-connector (the extra `ble`).

No other module imports these packages. All functions run in the thread of `ble_loop`.
"""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final, Protocol

from bridge.reasons.codes import Code, Sentence

if TYPE_CHECKING:
    from bleak import BleakClient

NEEDS: Final = "needs another package: pip install 'truerate[ble]'"
SEARCH_S: Final = 10.0  # for the device's advertisement
_PACKAGES: Final = ("bleak", "bleak_retry_connector")


class RadioFault(Exception):
    """Error of a BLE operation: code of the reason, and the parameters of the code other than `place`."""

    def __init__(self, code: Code, **params: object) -> None:
        super().__init__(code)
        self.code, self.params = code, params

    def at(self, place: str) -> Sentence:
        """Return the reason of the failure as a sentence. place: the device's address, for the text."""
        return self.code(place=place, **self.params)


class Connection(Protocol):
    """Interface of a connection to one BLE device."""

    async def listen(self, characteristic: str, heard: Callable[[bytes], None]) -> None:
        """Call `heard` with each notification of a characteristic, in order. Raises RadioFault if the device refuses."""

    async def write(self, characteristic: str, data: bytes) -> None:
        """Write data to a characteristic of the device. Raises RadioFault if that fails."""

    async def read(self, characteristic: str) -> bytes:
        """Read and return a characteristic's value; raises RadioFault if that fails."""

    async def close(self) -> None:
        """Disconnect from the device; never raises."""


class Radio(Protocol):
    """Interface of a maker of BLE connections."""

    async def connect(self, address: str, lost: Callable[[], None]) -> Connection:
        """Connect to the device with this Bluetooth address; `lost` is called when the connection ends for any reason.

        Raises RadioFault if no connection can be made.
        """


def available() -> bool:
    """Return True if the packages of the extra `ble` are installed."""
    return all(importlib.util.find_spec(name) is not None for name in _PACKAGES)


class BleakRadio:
    """Maker of BLE connections by the machine's own Bluetooth adapter and BlueZ."""

    async def connect(self, address: str, lost: Callable[[], None]) -> Connection:
        """Connect to a BLE device, after ending a connection that an earlier run left open.

        address: Bluetooth address. lost: called when the connection ends for any reason.
        Failures that BlueZ reports as transient are tried again. Raises RadioFault if no connection can be made.
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
    """Return the fault for a device that lacks a characteristic; the fault lists the device's characteristics.

    wanted: identifier of the missing characteristic. there: the device's characteristics, as lists of properties (such
    as `notify`) by identifier.
    """
    listed = ", ".join(f"{uuid} ({' '.join(properties)})" for uuid, properties in there.items())
    return RadioFault(Code.BLE_NO_CHARACTERISTIC, wanted=wanted, listed=listed or "none")


def fault(error: Exception) -> RadioFault:
    """Return the RadioFault for an error of bleak or the operating system, with the code of the reason."""
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
