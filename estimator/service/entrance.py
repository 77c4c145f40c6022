"""Entrance filter for messages: by enrolment, number of new devices, and ownership of the device.

Anybody who may publish samples can invent device ids. If no `[devices]` list names the ward's devices, the number of
uncalibrated devices and the rate of their admission are bounded. So a burst of new devices delays no other device.
"""

import logging
from collections import Counter
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from bridge.wire import keys
from bridge.wire.refusal import Tally
from estimator.service.cluster import Cluster
from estimator.service.device_roster import DeviceRoster
from estimator.service.enrolment_gate import EnrolmentGate

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
    """Filter that admits known devices and a bounded number of new, uncalibrated devices.

    exempt(device): whether a device is admitted in any case, because it is known or was calibrated before.
    """

    def __init__(self, exempt: Callable[[str], bool], counts: Tally) -> None:
        self._exempt, self._counts = exempt, counts
        #: devices on probation with their bridges, and the time at which each was admitted
        self._probation: dict[tuple[str, str], float] = {}
        self._by_bridge = Counter[str]()
        self._tokens, self._refilled_s = AT_ONCE, float("-inf")

    def admits(self, bridge: str, device: str, now: float) -> bool:
        """Return whether a device from a bridge is admitted; a refusal is counted. now: monotonic time, s.

        An admitted device counts as new until it is calibrated or forgotten; the number of new devices is bounded.
        """
        if (bridge, device) in self._probation or self._exempt(device):
            return True
        if not self._room(bridge, now):
            return False
        self._probation[bridge, device] = now
        self._by_bridge[bridge] += 1
        return True

    def look(self, now: float, *, kept: Callable[[str], bool], proven: Callable[[str], bool]) -> None:
        """Remove calibrated and forgotten devices from the bounded number of new devices; called once a second.

        now: monotonic time, s. kept(device): whether the device is still in the roster. proven(device): whether it has
        a calibration.
        A device is forgotten if it is not in the roster FORGET_S seconds after its admission.
        """
        for (bridge, device), since in list(self._probation.items()):
            if (now - since > FORGET_S and not kept(device)) or proven(device):
                del self._probation[bridge, device]
                self._by_bridge[bridge] -= 1
        self._by_bridge = +self._by_bridge

    def _room(self, bridge: str, now: float) -> bool:
        """Return whether one more device of a bridge is admitted now; counts the message when not."""
        if self._by_bridge[bridge] < OF_ONE_BRIDGE and len(self._probation) < OF_ALL:
            self._tokens = min(AT_ONCE, self._tokens + PER_S * (now - self._refilled_s))
            self._refilled_s = now
            if self._tokens >= 1.0:
                self._tokens -= 1.0
                return True
        if self._counts.add(REFUSED) == 1:
            log.warning(
                "too many new devices at once (bridge %s): some are refused. If they are real, list the ward's devices in"
                " [devices] (further refusals are counted, not logged)",
                bridge,
            )
        return False


class Entrance:
    """Sorter of sample messages: of devices held by this estimator, of other admitted devices, of refused devices.

    newcomers: filter for new devices; None if a `[devices]` list names the ward's devices. Decisions are remembered by
    bus key until the next `look`, once a second.
    """

    def __init__(self, gate: EnrolmentGate, newcomers: Newcomers | None, cluster: Cluster) -> None:
        self._gate, self.newcomers, self._cluster = gate, newcomers, cluster
        #: device by admitted key; empty for a malformed key, which the decoder refuses and counts
        self._admitted: dict[str, str] = {}

    def enrolled(self, messages: Sequence[Message], now: float) -> list[Message]:
        """Return the messages of enrolled devices, and those with malformed keys.

        Messages of devices that are not enrolled are counted and left out. now: monotonic time, s.
        """
        return [one for one in messages if not all(ids := _ids(one.key)) or self._gate.admits(*ids, now)]

    def sort(self, messages: Sequence[Message], now: float) -> tuple[list[Message], dict[str, list[Message]]]:
        """Split messages into those of our devices, and, by device, those of admitted devices that we do not hold.

        now: monotonic time, s. If other estimators exist, messages of both kinds are also copied to the replay log, for
        a takeover. Messages of refused devices are counted and left out.
        """
        held, replay = self._cluster.membership.held, self._cluster.replay if self._cluster.company else None
        ours, others = list[Message](), dict[str, list[Message]]()
        for message in messages:
            device = self._admitted.get(message.key)
            if device is None and (device := self._judge(message.key, now)) is None:
                continue
            if not device or device in held:
                ours.append(message)
            else:
                others.setdefault(device, []).append(message)
            if device and replay is not None:
                replay.add(device, message, now)
        return ours, others

    def look(self, now: float, devices: DeviceRoster) -> None:
        """Forget silent refused devices and silent new devices; called once a second.

        Remembered decisions on bus keys are cleared. now: monotonic time, s. devices: the roster.
        """
        self._gate.look(now)
        if self.newcomers is not None:
            devices.forget(now, FORGET_S)
            self.newcomers.look(now, kept=devices.__contains__, proven=devices.proven)
        self._admitted.clear()

    def _judge(self, key: str, now: float) -> str | None:
        """The device of a key, empty where the key is malformed; None where the device is not admitted."""
        bridge, device = _ids(key)
        if device and not self._gate.admits(bridge, device, now):
            return None
        if device and self.newcomers is not None and not self.newcomers.admits(bridge, device, now):
            return None
        if len(self._admitted) >= _KEYS:
            self._admitted.clear()
        self._admitted[key] = device
        return device


def _ids(key: str) -> tuple[str, str]:
    """Bridge and device of a key; both empty where it is malformed."""
    _, bridge, device = ("", "", *key.rsplit("/", 2))[-3:]
    return (bridge, device) if keys.ID.match(device) and keys.ID.match(bridge) else ("", "")
