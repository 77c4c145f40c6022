"""Limit on the number of devices that an outlet shows, however many ids are invented. Time is an argument."""

import logging
from collections.abc import Callable

log = logging.getLogger(__name__)

#: most devices at an outlet
MOST = 1024
#: a device silent for so long leaves its place to a new one, s
SILENT_S = 60.0


class Places:
    """Set of the devices that an outlet shows, at most `most`; earlier devices keep their places.

    leave(device): called for each device that loses its place, which can happen after SILENT_S seconds without a
    message.
    """

    def __init__(self, leave: Callable[[str], None], most: int = MOST) -> None:
        self._leave, self._most = leave, most
        self._heard_s: dict[str, float] = {}  # the one silent for longest comes first
        self._warned = False

    def take(self, device: str, now_s: float) -> bool:
        """Return whether a device may be shown; give it a place if there is room.

        now_s: monotonic time at which the device was heard, s.
        """
        if self._heard_s.pop(device, None) is None and len(self._heard_s) >= self._most:
            first, heard_s = next(iter(self._heard_s.items()))
            if now_s - heard_s <= SILENT_S:
                self._warn(device)
                return False
            del self._heard_s[first]
            self._leave(first)
        self._heard_s[device] = now_s
        return True

    def _warn(self, device: str) -> None:
        if not self._warned:
            self._warned = True
            log.warning("%s and later devices are left out: at most %d devices can be shown", device, self._most)
