"""Checks that the recordings and captures that devices are played from exist and can be read."""

from collections.abc import Iterable

from bridge.config.schema import Device
from bridge.drivers import registry


def unreadable(devices: Iterable[Device]) -> list[str]:
    """A sentence for each device whose file cannot be read."""
    states = {device.id: (place, _state(device)) for device in devices if (place := _file(device))}
    return [f"device {name!r}: {place}: {state}" for name, (place, state) in states.items() if state != "present"]


def _file(device: Device) -> str:
    """What it is played from; empty for a device that is there itself."""
    port = str(getattr(device.options, "port", ""))
    return str(getattr(device.options, "file", "")) or (port if port.startswith("file://") else "")


def _state(device: Device) -> str:
    return registry.kinds()[device.driver].state(device.options)
