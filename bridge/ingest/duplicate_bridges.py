"""Words for a device that two bridges send: the estimator takes one bridge's samples and refuses the other's."""

import contextlib
import logging
from collections.abc import Iterable, Sequence

from bridge.bus.contract import Bus
from bridge.wire import keys
from bridge.wire.codec import decode_status
from bridge.wire.messages import Status
from bridge.wire.refusal import Refusal

_MOST = 4  # devices that are named
_AT_ONCE = 1000  # messages
_log = logging.getLogger(__name__)


def words(devices: Sequence[str], owner: str, refused: Sequence[str]) -> str:
    """One sentence: the devices, both bridges, whose samples are refused, and what to do."""
    whose = ", ".join(f"{bridge}'s" for bridge in refused)
    bridges = f"{'two' if len(refused) == 1 else len(refused) + 1} bridges, {', '.join([owner, *refused[:-1]])} and {refused[-1]}"
    what = "stop one" if len(refused) == 1 else "stop all but one"
    return f"{named(devices)} sent by {bridges}: {whose} samples are refused; {what}"


def named(devices: Sequence[str]) -> str:
    """The first few device names, with the verb."""
    if len(devices) == 1:
        return f"device {devices[0]} is"
    left = len(devices) - _MOST
    return f"devices {', '.join(devices[:_MOST])}{f' and {left} more' if left > 0 else ''} are"


def found(statuses: Iterable[Status]) -> list[str]:
    """A sentence for each set of bridges that send the same devices now."""
    sets: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for status in statuses:
        if status.refused_bridges:
            sets.setdefault((status.bridge, tuple(sorted(status.refused_bridges))), []).append(status.device)
    return [words(sorted(devices), owner, refused) for (owner, refused), devices in sorted(sets.items())]


class DuplicateBridges:
    """A bridge's own devices that estimators refuse; the first refusal of each is logged."""

    def __init__(self, bus: Bus, ward: str, bridge: str, devices: Iterable[str]) -> None:
        self._bridge, self._devices, self._told = bridge, frozenset(devices), set[str]()
        #: of which another bridge is listened to, as far as was said last
        self.refused: set[str] = set()
        self._statuses = bus.subscribe(keys.pattern(ward, "status"), history=True, capacity=2 * _AT_ONCE)

    def hear(self) -> None:
        """Take the statuses that estimators have published since the last call."""
        for message in self._statuses.drain(_AT_ONCE, 0.0):
            with contextlib.suppress(Refusal):  # whoever sent it is told of by those whom it is for
                self._take(decode_status(*message))

    def close(self) -> None:
        """Unsubscribe."""
        self._statuses.close()

    def _take(self, status: Status) -> None:
        device = status.device
        if device not in self._devices:
            return
        if self._bridge not in status.refused_bridges:
            if status.bridge == self._bridge:
                self.refused.discard(device)
            return
        self.refused.add(device)
        if device not in self._told:
            self._told.add(device)
            _log.warning("%s (said once)", words([device], status.bridge, status.refused_bridges))
