"""Known devices: a bounded number; those that are gone and were never calibrated make room."""

import logging
from heapq import nsmallest

from bridge.wire.messages import DeviceInfo
from bridge.wire.refusal import Tally
from estimator.service.device import Device

log = logging.getLogger(__name__)

MAX_DEVICES = 4096
_AT_ONCE = 64
#: under this, samples there was no room for a device for are counted
TOO_MANY = "samples refused, too many devices"
#: where no room was found, none is looked for again so soon
_LOOK_S = 1.0


class DeviceRoster(dict[str, Device]):
    """Devices by name, and what their bridges say of them."""

    def __init__(self, counts: Tally, silence_s: float) -> None:
        super().__init__()
        self._counts, self._silence_s = counts, silence_s
        self._infos: dict[tuple[str, str], DeviceInfo] = {}
        self._full_until_s = float("-inf")

    def room(self, now: float, samples: int) -> bool:
        """Whether one more device can be had at `now`, monotonic seconds; counts its samples when not."""
        if len(self) < MAX_DEVICES or (now >= self._full_until_s and self.forget(now, self._silence_s)):
            return True
        self._full_until_s = max(self._full_until_s, now + _LOOK_S) if now >= self._full_until_s else self._full_until_s
        if self._counts.add(TOO_MANY, samples) == samples:
            log.error(
                "there are %d devices, no more are taken; is somebody making them up? (more are only counted)",
                len(self),
            )
        return False

    def info(self, bridge: str, device: str) -> DeviceInfo | None:
        """What a bridge said last of a device."""
        return self._infos.get((bridge, device))

    def note(self, info: DeviceInfo) -> None:
        """Keep what a bridge says of a device; of those that send nothing the longest unheard is forgotten for it."""
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
        return device in self and self[device].admission.source.owner == bridge

    def proven(self, name: str) -> bool:
        """Whether a device is here and has a calibration."""
        return name in self and not self[name].worthless

    def forget(self, now: float, silent_s: float) -> bool:
        """Forget devices without a calibration that were silent for longer, those heard longest ago first; whether any was."""
        gone = [d for d in self.values() if d.worthless and now - d.heard > silent_s]
        for device in nsmallest(_AT_ONCE, gone, key=lambda d: d.heard):
            del self[device.name]
            device.close()
            self._counts.add("devices forgotten")
        return bool(gone)
