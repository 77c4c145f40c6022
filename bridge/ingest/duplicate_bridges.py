"""Detection of devices that two bridges send: the estimator uses one bridge's samples and refuses the other's."""

import contextlib
import logging
from collections.abc import Iterable, Sequence

from bridge.bus.contract import Bus
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence
from bridge.wire import keys
from bridge.wire.codec import decode_status
from bridge.wire.messages import Status
from bridge.wire.refusal import Refusal

_MOST = 4  # devices named in a sentence
_AT_ONCE = 1000  # messages handled per call
_log = logging.getLogger(__name__)


def said(devices: Sequence[str], owner: str, refused: Sequence[str]) -> Sentence:
    """Return a sentence which states that several bridges send the same devices, and what to do.

    devices: ids of these devices; the sentence names the first four. owner: id of the bridge whose samples are used.
    refused: ids of the other bridges.
    """
    params = {"devices": ", ".join(devices[:_MOST]), "owner": owner, "refused": ", ".join(refused)}
    if (left := len(devices) - _MOST) > 0:
        return Code.TWO_BRIDGES_AND_MORE(more=left, **params)
    return Code.TWO_BRIDGES(**params)


def found(statuses: Iterable[Status]) -> list[Sentence]:
    """Return one sentence for each set of bridges that send the same devices.

    statuses: latest status of each device, as an estimator publishes it.
    """
    sets: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for status in statuses:
        if status.refused_bridges:
            sets.setdefault((status.bridge, tuple(sorted(status.refused_bridges))), []).append(status.device)
    return [said(sorted(devices), owner, refused) for (owner, refused), devices in sorted(sets.items())]


class DuplicateBridges:
    """Tracks for which devices of a bridge the estimators use the samples of another bridge; logs each such device once.

    bus: open session, to read the estimators' statuses. ward, bridge: ids. devices: ids of the bridge's devices.
    refused: ids of the devices whose samples are used from another bridge, by the estimators' latest statuses.
    """

    def __init__(self, bus: Bus, ward: str, bridge: str) -> None:
        self._bridge, self._told = bridge, set[str]()
        #: the bridge's devices, which may change
        self.devices = frozenset[str]()
        #: devices taken from another bridge, by the latest status
        self.refused: set[str] = set()
        self._statuses = bus.subscribe(keys.pattern(ward, "status"), history=True, capacity=2 * _AT_ONCE)

    def hear(self) -> None:
        """Read the statuses that estimators have published since the last call, and update `refused`."""
        for message in self._statuses.drain(_AT_ONCE, 0.0):
            with contextlib.suppress(Refusal):  # others report invalid statuses
                self._take(decode_status(*message))

    def close(self) -> None:
        """Unsubscribe from the estimators' statuses."""
        self._statuses.close()

    def _take(self, status: Status) -> None:
        device = status.device
        if device not in self.devices:
            return
        if self._bridge not in status.refused_bridges:
            if status.bridge == self._bridge:
                self.refused.discard(device)
            return
        self.refused.add(device)
        if device not in self._told:
            self._told.add(device)
            _log.warning("%s (logged once)", english(said([device], status.bridge, status.refused_bridges)))
