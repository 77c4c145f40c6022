"""Checks that the recording or capture file of each played-back device exists and is readable."""

from collections.abc import Iterable

from bridge.config.schema import Device
from bridge.drivers import registry


def unreadable(devices: Iterable[Device]) -> list[str]:
    """Return a sentence for each played-back device whose recording or capture file is missing or cannot be read.

    Devices that are not played back from a file are skipped.
    """
    states = {device.id: (place, _state(device)) for device in devices if (place := _file(device))}
    return [f"device {name!r}: {place}: {state}" for name, (place, state) in states.items() if state != "present"]


def _file(device: Device) -> str:
    """Return the file a device is played back from; empty for a real device."""
    port = str(getattr(device.options, "port", ""))
    return str(getattr(device.options, "file", "")) or (port if port.startswith("file://") else "")


def _state(device: Device) -> str:
    return registry.kinds()[device.driver].state(device.options)
