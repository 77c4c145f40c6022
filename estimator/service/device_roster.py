"""Roster of known devices: bounds their number, and lets a failure in one device's work affect that device only.

Silent devices that were never calibrated make room for new ones.
"""

import logging
from collections import Counter
from collections.abc import Callable
from heapq import nsmallest
from typing import TypeVarTuple

from bridge.bus.contract import BusError
from bridge.wire.messages import DeviceInfo
from bridge.wire.refusal import Tally
from estimator.device.attention import ended
from estimator.service.device import Device

log = logging.getLogger(__name__)

Ts = TypeVarTuple("Ts")

#: most devices of one estimator
MAX_DEVICES = 4096
_AT_ONCE = 64
#: a device that ended is forgotten after this time, s
ENDED_S = 600.0
#: a bridge sends the info of each of its devices once a second
RECENT_NS = 5_000_000_000
#: samples refused because the roster is full are counted under this name
TOO_MANY = "samples refused, too many devices"
#: event of a device whose session ended by an error
FAILED = "session failed"


class DeviceRoster(dict[str, Device]):
    """Known devices by id, at most MAX_DEVICES, and the latest info that each bridge sent of each device.

    counts: the ward's counts of refused and lost messages. silence_s: silence after which an uncalibrated device may
    make room for another, s.
    """

    def __init__(self, counts: Tally, silence_s: float) -> None:
        super().__init__()
        self._counts, self._silence_s = counts, silence_s
        self._infos: dict[tuple[str, str], DeviceInfo] = {}

    def room(self, now: float, samples: int) -> bool:
        """Return whether one more device fits; forgets silent uncalibrated devices if necessary.

        now: monotonic time, s. samples: number of samples to count as refused if there is no room.
        """
        if len(self) < MAX_DEVICES or self.forget(now, self._silence_s):
            return True
        if self._counts.add(TOO_MANY, samples) == samples:
            log.error(
                "at most %d devices are allowed; further devices are refused and counted: list the ward's devices in [devices]",
                len(self),
            )
        return False

    def info(self, bridge: str, device: str) -> DeviceInfo | None:
        """Return the latest info (identity and settings) that a bridge sent of a device, or None."""
        return self._infos.get((bridge, device))

    def note(self, info: DeviceInfo) -> None:
        """Keep the latest info that a bridge sent of a device, for at most MAX_DEVICES pairs of bridge and device.

        Beyond that, the oldest info of a device that sends nothing is dropped.
        """
        name = info.bridge, info.device
        self._infos.pop(name, None)
        if len(self._infos) >= MAX_DEVICES:
            self._counts.add("infos forgotten")
            unheard = next((n for n in self._infos if not self._heard(n)), None)
            if unheard is None and not self._heard(name):
                return
            del self._infos[unheard or next(iter(self._infos))]
        self._infos[name] = info

    def _heard(self, name: tuple[str, str]) -> bool:
        bridge, device = name
        return device in self and self[device].admission.owner == bridge

    def proven(self, name: str) -> bool:
        """Return whether a device is known and has a calibration, of this boot or an earlier one."""
        return name in self and not self[name].worthless

    def forget(self, now: float, silent_s: float) -> bool:
        """Forget uncalibrated devices silent for over `silent_s` seconds, the longest silent first, up to 64 per call.

        now: monotonic time, s. Returns whether any device was forgotten.
        """
        gone = [d for d in self.values() if d.worthless and now - d.heard > silent_s]
        for device in nsmallest(_AT_ONCE, gone, key=lambda d: d.heard):
            del self[device.name]
            device.close()
            self._counts.add("devices forgotten")
        return bool(gone)

    def listed_by(self, device: str, alive: Callable[[str], bool]) -> str:
        """Return the id of a live bridge whose latest infos include the device; empty if there is none.

        alive(bridge): whether a bridge is alive.
        """
        latest = Counter[str]()
        for (bridge, _), info in self._infos.items():
            latest[bridge] = max(latest[bridge], info.time_ns)
        for (bridge, name), info in self._infos.items():
            recent = info.time_ns > latest[bridge] - RECENT_NS  # of the bridge's own clock
            if name == device and recent and not ended(info.trouble) and alive(bridge):
                return bridge
        return ""

    def guard(self, device: Device, work: Callable[[*Ts], object], *args: *Ts) -> bool:
        """Run work(*args) for one device and return whether it succeeded; after a failure a new session starts.

        Raises BusError, since a lost bus concerns all devices.
        """
        try:
            work(*args)
        except Exception as error:  # noqa: BLE001 - any failure is contained: see `failed`
            self.failed(device, error)
            return False
        return True

    def failed(self, device: Device, error: Exception) -> None:
        """Restart the session of a device whose work failed, so that the other devices are not affected.

        The device's samples that were received and not published are counted as lost. A BusError is raised again, since
        a lost bus concerns all devices.
        """
        if isinstance(error, BusError):
            raise error
        device.restart()
        self._counts.add("sessions failed")
        if device.session.count_event(FAILED) == 1:
            words = "%s: an error ended the device's session, and a new session starts (further errors are counted, not logged)"
            log.error(words, device.name, exc_info=error)

    def over(self, now: float) -> list[Device]:
        """Return the devices that are not expected to send again and have been silent for over ENDED_S seconds.

        now: monotonic time, s.
        """
        return [device for device in self.values() if device.ended and now - device.heard > ENDED_S]
