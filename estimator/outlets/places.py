"""Places of devices at an outlet: however many devices are invented, a bounded number is shown. Time is an argument."""

import logging
from collections.abc import Callable

log = logging.getLogger(__name__)

#: most devices at an outlet
MOST = 1024
#: a device silent for so long leaves its place to a new one, s
SILENT_S = 60.0
#: shortest time between two searches for a free place, s
_SEARCH_S = 1.0


class Places:
    """Devices that an outlet shows; those heard first keep their place. leave: called with each device that leaves."""

    def __init__(self, leave: Callable[[str], None], most: int = MOST) -> None:
        self._leave, self._most = leave, most
        self._heard_s: dict[str, float] = {}
        self._full_until_s = float("-inf")
        self._warned = False

    def take(self, device: str, now_s: float) -> bool:
        """Whether a device, heard now, has a place."""
        if device not in self._heard_s and not self._room(device, now_s):
            return False
        self._heard_s[device] = now_s
        return True

    def _room(self, device: str, now_s: float) -> bool:
        if len(self._heard_s) < self._most:
            return True
        if now_s < self._full_until_s:
            return False
        for name in [name for name, heard_s in self._heard_s.items() if now_s - heard_s > SILENT_S]:
            del self._heard_s[name]
            self._leave(name)
        if len(self._heard_s) < self._most:
            return True
        self._full_until_s = now_s + _SEARCH_S
        if not self._warned:
            self._warned = True
            log.warning("%s is left out, as later devices will be: %d devices are shown already", device, self._most)
        return False
