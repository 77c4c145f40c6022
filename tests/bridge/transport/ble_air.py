"""Bluetooth without Bluetooth: bumble's virtual controllers on one link, behind the interface that bleak is used through."""

import asyncio
from collections.abc import Callable
from typing import Any

from bumble.controller import Controller
from bumble.device import Connection, Device, Peer
from bumble.gatt import Characteristic, CharacteristicValue, Service
from bumble.hci import Address
from bumble.host import Host
from bumble.link import LocalLink
from bumble.transport.common import AsyncPipeSink

from bridge.reasons.codes import Code
from bridge.transport import ble_loop
from bridge.transport.ble_radio import RadioFault, no_characteristic

NOTIFY, WRITE = "ffe4", "ffe9"
_SERVICE = "ffe5"


class Wearable:
    """A device that notifies and can be written to."""

    def __init__(self, air: "Air", number: int) -> None:
        self.address = f"F0:00:00:00:00:{number:02X}"
        self.written: list[bytes] = []
        properties = Characteristic.Properties
        self._notify: Any = Characteristic(NOTIFY, properties.NOTIFY, Characteristic.Permissions(0), b"")
        value = CharacteristicValue(write=lambda _, data: self.written.append(bytes(data)))
        write: Any = Characteristic(
            WRITE, properties.WRITE_WITHOUT_RESPONSE, Characteristic.Permissions.WRITEABLE, value
        )
        self._device = air.device(self.address)
        self._device.add_service(Service(_SERVICE, [self._notify, write]))

    async def be_seen(self) -> None:
        await self._device.power_on()
        await self._device.start_advertising(
            auto_restart=True, advertising_interval_min=20, advertising_interval_max=20
        )

    async def notify(self, data: list[bytes]) -> None:
        for each in data:
            await self._device.notify_subscribers(self._notify, each)

    async def hang_up(self) -> None:
        for connection in list(self._device.connections.values()):
            await connection.disconnect()


class Air:
    """What is between the devices and us. A Radio; its devices may be told what to do from the test's thread."""

    def __init__(self) -> None:
        self._link = LocalLink()  # type: ignore[no-untyped-call]
        self._seen: set[str] = set()
        self._central = self.device("F0:00:00:00:00:FF")
        self._on = False

    def device(self, address: str) -> Device:
        self._seen.add(address)
        controller = Controller(address, link=self._link, public_address=address)
        return Device(address=Address(address), host=Host(controller, AsyncPipeSink(controller)))

    async def connect(self, address: str, lost: Callable[[], None]) -> "_Connected":
        if not self._on:
            await self._central.power_on()
            self._on = True
        if address not in self._seen:  # bumble's controller does not end a search that finds nothing
            raise RadioFault(Code.BLE_NOT_HEARD)
        connection = await self._central.connect(Address(address))
        connection.on(connection.EVENT_DISCONNECTION, lambda _: lost())
        peer = Peer(connection)
        await peer.request_mtu(247)  # as BlueZ does by itself
        await peer.discover_services()
        await peer.discover_characteristics()
        return _Connected(connection, peer)


class _Connected:
    def __init__(self, connection: Connection, peer: Peer) -> None:
        self._connection = connection
        self._there = {
            each.uuid.to_hex_str("-").lower(): each for service in peer.services for each in service.characteristics
        }

    def _find(self, uuid: str) -> Any:
        found = self._there.get(uuid) or self._there.get(uuid[4:8])
        if found is None:
            raise no_characteristic(uuid, {each: [] for each in self._there})
        return found

    async def listen(self, characteristic: str, heard: Callable[[bytes], None]) -> None:
        await self._find(characteristic).subscribe(lambda value: heard(bytes(value)))

    async def write(self, characteristic: str, data: bytes) -> None:
        await self._find(characteristic).write_value(data, with_response=False)

    async def read(self, characteristic: str) -> bytes:
        return bytes(await self._find(characteristic).read_value())

    async def close(self) -> None:
        if self._connection.handle in self._connection.device.connections:
            await self._connection.disconnect()


async def _made(numbers: int) -> tuple[Air, list[Wearable]]:
    air = Air()
    wearables = [Wearable(air, number) for number in range(1, numbers + 1)]
    for wearable in wearables:
        await wearable.be_seen()
    return air, wearables


def made(numbers: int) -> tuple[Air, list[Wearable]]:
    """So many wearables, waiting to be connected to."""
    return ble_loop.run(_made(numbers)).result(60)


def settle() -> None:
    """Let what is under way happen."""
    ble_loop.run(asyncio.sleep(0.05)).result(60)
