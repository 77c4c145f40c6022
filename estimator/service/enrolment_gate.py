"""Enrolment gate: admits only messages of enrolled devices from their own bridge.

Bus keys are checked before anything is decoded, so that a flood of invented names delays no device. Some refused device
ids are remembered, so that a person can see which devices ask to be admitted.
"""

import logging
from collections.abc import Container
from dataclasses import dataclass, replace

from bridge.bus.contract import Bus, Publisher
from bridge.config.enrolment import Enrolment
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Status
from bridge.wire.refusal import Tally
from estimator.device.session import DeviceSession
from estimator.service import output

log = logging.getLogger(__name__)

#: refused messages are counted under these names
STRANGER, FOREIGN = "messages refused, not enrolled", "messages refused, another bridge's device"
#: most strangers listed, and how long each is listed after its last message, s
LISTED, LISTED_S = 64, 30.0


@dataclass(slots=True)
class Stranger:
    """Device that is not enrolled, or is enrolled with another bridge than the one that sends it.

    messages: number of refused messages. heard: time of the latest one, monotonic s.
    """

    bridge: str
    messages: int
    heard: float


class EnrolmentGate:
    """Filter that admits messages by enrolment.

    enrolment: the `[devices]` table of the ward file; None admits every device. `strangers`: some of the refused
    devices, by id.
    """

    def __init__(self, enrolment: Enrolment | None, counts: Tally) -> None:
        self._enrolment, self._counts = enrolment, counts
        self._places = enrolment.places if enrolment else {}
        self._heard = set[str]()  # enrolled devices heard from their own bridges
        self.strangers: dict[str, Stranger] = {}

    def look(self, now: float) -> None:
        """Drop strangers (refused devices) that were silent for LISTED_S seconds; called once a second.

        Strangers that their own bridge has sent since are dropped, too. now: monotonic time, s.
        """
        gone = [name for name, stranger in self.strangers.items() if now - stranger.heard > LISTED_S]
        for name in {*gone, *(self.strangers.keys() & self._heard)}:
            del self.strangers[name]

    def lists(self, device: str) -> bool:
        """Return whether the `[devices]` table lists a device."""
        return device in self._places

    def enrol(self, enrolment: Enrolment) -> None:
        """Apply a changed `[devices]` table; does nothing if there was no table before."""
        if self._enrolment is None or enrolment == self._enrolment:
            return
        before, self._enrolment, self._places = len(self._places), enrolment, enrolment.places
        log.info("[devices]: %d devices are enrolled now, %d before", len(self._places), before)
        self._heard.clear()
        for name in self.strangers.keys() & self._places.keys():
            del self.strangers[name]

    def why(self, device: str, bridge: str = "") -> Sentences:
        """Return the reasons why messages of a device from a bridge are refused; empty if they are admitted.

        bridge: empty stands for any bridge.
        """
        place = self._places.get(device)
        if place and bridge and place != bridge:
            return (Code.ENROLLED_ELSEWHERE(place=place, bridge=bridge),)
        return () if self._enrolment is None or place is not None else (Code.NOT_ENROLLED(),)

    def admits(self, bridge: str, device: str, now: float) -> bool:
        """Return whether a message of a device from this bridge is admitted. now: monotonic time, s.

        A refused message is counted, and its device may be added to `strangers`.
        """
        if self._enrolment is None:
            return True
        place = self._places.get(device)
        if place is None:
            if self._counts.add(STRANGER) == 1:
                log.warning("%s: %s (logged once)", device, english(*self.why(device)))
            self._list(device, bridge, now)
            return False
        if place and place != bridge:
            if self._counts.add(FOREIGN) == 1:
                log.warning(
                    "%s is enrolled for bridge %s but sent by %s (further messages are counted, not logged)",
                    device,
                    place,
                    bridge,
                )
            if device not in self._heard:
                self._list(device, bridge, now)
            return False
        self._heard.add(device)
        return True

    def _list(self, device: str, bridge: str, now: float) -> None:
        stranger = self.strangers.get(device)
        if stranger is not None:
            stranger.messages += 1
            stranger.heard = now
        elif len(self.strangers) < LISTED:
            self.strangers[device] = Stranger(bridge, 1, now)


class Notices:
    """Publisher of a status for each refused device (stranger), so that strangers appear in every list of devices."""

    def __init__(self, bus: Bus, ward: str, gate: EnrolmentGate) -> None:
        self._bus, self._ward, self._gate = bus, ward, gate
        self._blank: Status = output.status(DeviceSession("none").status(0))
        self._publishers: dict[str, Publisher] = {}

    def say(self, time_ns: int, known: Container[str]) -> None:
        """Publish the statuses of the strangers, once a second.

        known: ids of devices that have a status already; these are left out. time_ns: host time, ns since the Unix
        epoch.
        """
        for name in self._publishers.keys() - self._gate.strangers.keys():
            self._publishers.pop(name).close()
        for name, stranger in self._gate.strangers.items():
            if name in known:
                continue
            if name not in self._publishers:
                key = keys.build(self._ward, "status", device=name)
                self._publishers[name] = self._bus.publisher(key, cache=1)
            said = replace(
                self._blank,
                device=name,
                time_ns=time_ns,
                reason=self._gate.why(name, stranger.bridge),
                events={STRANGER: stranger.messages},
                bridge=stranger.bridge,
            )
            self._publishers[name].put(codec.encode_status(said))

    def close(self) -> None:
        """Close the publishers of the strangers' statuses."""
        for publisher in self._publishers.values():
            publisher.close()
        self._publishers.clear()
