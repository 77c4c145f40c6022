"""Entrance of messages: which are decoded, by enrolment, number of new devices, and ownership of the device."""

from collections.abc import Sequence

from bridge.bus.contract import Message
from bridge.wire import keys
from estimator.service.cluster import Cluster
from estimator.service.device_roster import DeviceRoster
from estimator.service.enrolment_gate import EnrolmentGate
from estimator.service.newcomers import FORGET_S, Newcomers

#: most keys remembered as admitted
_KEYS = 16_384


class Entrance:
    """Sorts messages by owner of their device. A key is judged once, and anew after `look`, once a second.

    newcomers: bounds new devices where no `[devices]` list names the ward's devices; None where one does.
    """

    def __init__(self, gate: EnrolmentGate, newcomers: Newcomers | None, cluster: Cluster) -> None:
        self._gate, self.newcomers, self._cluster = gate, newcomers, cluster
        #: device by admitted key; empty for a malformed key, which the decoder refuses and counts
        self._admitted: dict[str, str] = {}

    def enrolled(self, messages: Sequence[Message], now: float) -> list[Message]:
        """Messages of enrolled devices, and those with malformed keys; the gate counts the others. now: monotonic s."""
        return [one for one in messages if not all(ids := _ids(one.key)) or self._gate.admits(*ids, now)]

    def sort(self, messages: Sequence[Message], now: float) -> tuple[list[Message], dict[str, list[Message]]]:
        """Messages of our devices, and messages of admitted devices that we do not hold, by device. now: monotonic s.

        Beside other estimators all of them are kept for replay. Messages of refused devices are counted.
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
        """Once a second: reload enrolment, forget silent new devices, and judge every key anew."""
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
