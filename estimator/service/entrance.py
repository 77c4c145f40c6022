"""Entrance of sample messages: which are decoded, by enrolment, number of new devices, and ownership of the device."""

from collections.abc import Sequence

from bridge.bus.contract import Message
from bridge.wire import keys
from bridge.wire.refusal import Refusal
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

    def sort(self, messages: Sequence[Message], now: float) -> tuple[list[Message], dict[str, list[Message]]]:
        """Messages of our devices, and messages of admitted devices that we do not hold, by device. now: monotonic s.

        Beside other estimators all of them are kept for replay. Messages of refused devices are counted by the gate.
        """
        held, replay = self._cluster.membership.held, self._cluster.replay if self._cluster.company else None
        ours, others = list[Message](), dict[str, list[Message]]()
        for message in messages:
            device = self._admitted.get(message.key)
            if device is None and (device := self._judge(message, now)) is None:
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

    def _judge(self, message: Message, now: float) -> str | None:
        """The device of a message, empty where its key is malformed; None where the device is not admitted."""
        if not self._gate.admits(message.key, now):
            return None
        if self.newcomers is not None and not self.newcomers.admit([message], now):
            return None
        try:
            device = keys.parse(message.key).device
        except Refusal:
            device = ""
        if len(self._admitted) >= _KEYS:
            self._admitted.clear()
        self._admitted[message.key] = device
        return device
