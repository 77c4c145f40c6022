"""Admission of uncalibrated devices where no `[devices]` list names the ward's devices. Pure.

Anybody who may publish samples can invent device ids. Their number and the rate at which they are admitted are bounded,
so that a burst of them delays no device that was heard before.
"""

import logging
from collections import Counter
from collections.abc import Callable

from bridge.wire.refusal import Tally

log = logging.getLogger(__name__)

#: most uncalibrated devices admitted at a time, from one bridge and from all bridges
OF_ONE_BRIDGE, OF_ALL = 256, 512
#: newcomers admitted at once, and further ones per second
AT_ONCE, PER_S = 16.0, 16.0
#: an uncalibrated device is forgotten after this silence, s
FORGET_S = 60.0
#: refused messages are counted under this name
REFUSED = "messages refused, too many new devices"


class Newcomers:
    """Filter that admits known devices and a bounded number of new ones.

    exempt(device): whether a device is admitted regardless of numbers, because it is known or was calibrated before.
    """

    def __init__(self, exempt: Callable[[str], bool], counts: Tally) -> None:
        self._exempt, self._counts = exempt, counts
        #: devices on probation with their bridges, and the time at which each was admitted
        self._probation: dict[tuple[str, str], float] = {}
        self._by_bridge = Counter[str]()
        self._tokens, self._refilled_s = AT_ONCE, float("-inf")

    def admits(self, bridge: str, device: str, now: float) -> bool:
        """Whether a device is admitted from a bridge; a refusal is counted. now: monotonic s."""
        if (bridge, device) in self._probation or self._exempt(device):
            return True
        if not self._room(bridge, now):
            return False
        self._probation[bridge, device] = now
        self._by_bridge[bridge] += 1
        return True

    def look(self, now: float, *, kept: Callable[[str], bool], proven: Callable[[str], bool]) -> None:
        """Once a second: end the probation of devices that are proven or no longer kept."""
        for (bridge, device), since in list(self._probation.items()):
            if (now - since > FORGET_S and not kept(device)) or proven(device):
                del self._probation[bridge, device]
                self._by_bridge[bridge] -= 1
        self._by_bridge = +self._by_bridge

    def _room(self, bridge: str, now: float) -> bool:
        """Whether one more device of a bridge is admitted now; counts the message when not."""
        if self._by_bridge[bridge] < OF_ONE_BRIDGE and len(self._probation) < OF_ALL:
            self._tokens = min(AT_ONCE, self._tokens + PER_S * (now - self._refilled_s))
            self._refilled_s = now
            if self._tokens >= 1.0:
                self._tokens -= 1.0
                return True
        if self._counts.add(REFUSED) == 1:
            log.warning(
                "more new devices send than are admitted at once (bridge %s; more are only counted): list the ward's devices in"
                " [devices] if they are real",
                bridge,
            )
        return False
