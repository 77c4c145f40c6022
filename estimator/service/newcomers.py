"""Admission of uncalibrated devices where no `[devices]` list names the ward's devices. Pure.

Anybody who may publish samples can invent device ids. Their number and the rate at which they are admitted are bounded,
so that a burst of them delays no device that was heard before. A refused message costs a set lookup and a split of its
key.
"""

import logging
from collections import Counter
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from bridge.wire import keys
from bridge.wire.refusal import Tally

log = logging.getLogger(__name__)

#: most uncalibrated devices admitted at a time, from one bridge and from all bridges
OF_ONE_BRIDGE, OF_ALL = 256, 512
#: newcomers admitted at once, and further ones per second
AT_ONCE, PER_S = 16.0, 16.0
#: an uncalibrated device is forgotten after this silence, s
FORGET_S = 60.0
#: most keys remembered as admitted
_KEYS = 16_384
#: refused messages are counted under this name
REFUSED = "messages refused, too many new devices"


class Newcomers:
    """Filter that admits messages of known devices and a bounded number of new ones.

    exempt(device): whether a device is admitted regardless of numbers, because it is known or was calibrated before.
    """

    def __init__(self, exempt: Callable[[str], bool], counts: Tally) -> None:
        self._exempt, self._counts = exempt, counts
        self._admitted = set[str]()
        #: keys of devices on probation, with the time at which each was admitted
        self._probation: dict[str, float] = {}
        self._by_bridge = Counter[str]()
        self._tokens, self._refilled_s = AT_ONCE, float("-inf")

    def admit(self, messages: Sequence[Message], now: float) -> list[Message]:
        """Messages of admitted devices, and those with malformed keys, which the decoder refuses. now: monotonic s."""
        admitted = self._admitted
        return [message for message in messages if message.key in admitted or self._admits(message.key, now)]

    def look(self, now: float, *, kept: Callable[[str], bool], proven: Callable[[str], bool]) -> None:
        """Once a second: end the probation of devices that are proven or no longer kept."""
        for key, since in list(self._probation.items()):
            _, bridge, device = key.rsplit("/", 2)
            gone = now - since > FORGET_S and not kept(device)
            if gone or proven(device):
                del self._probation[key]
                self._by_bridge[bridge] -= 1
                if gone:
                    self._admitted.discard(key)
        self._by_bridge = +self._by_bridge

    def _admits(self, key: str, now: float) -> bool:
        _, bridge, device = ("", "", *key.rsplit("/", 2))[-3:]
        if not (keys.ID.match(device) and keys.ID.match(bridge)):
            return True
        if not self._exempt(device):
            if not self._room(bridge, now):
                return False
            self._probation[key] = now
            self._by_bridge[bridge] += 1
        if len(self._admitted) >= _KEYS:
            self._admitted = set(self._probation)
        self._admitted.add(key)
        return True

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
