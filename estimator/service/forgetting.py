"""Removal of devices: those that will not send again, such as ended recordings, and those that a person removes."""

import time

from bridge.reasons.codes import Code, Sentence
from bridge.wire import keys
from estimator.alerts.board import Change
from estimator.service.device import Device
from estimator.service.enrolment_gate import EnrolmentGate
from estimator.service.parts import Parts
from estimator.service.periodic_checks import PeriodicChecks
from estimator.service.presence import Presence

#: commands that remove a device: from memory and pages, and from the store as well
FORGET, ERASE = "forget", "erase"


class Forgetting:
    """Remover of devices from this estimator's memory, from the web pages, and on request from the store."""

    def __init__(self, parts: Parts, gate: EnrolmentGate, presence: Presence, checks: PeriodicChecks) -> None:
        self._parts, self._gate, self._presence, self._checks = parts, gate, presence, checks

    def look(self, now: float) -> None:
        """Forget devices that are not expected to send again and were silent for ENDED_S seconds.

        Called once a second. now: monotonic time, s. The devices' entries in the store remain.
        """
        for device in self._parts.devices.over(now):
            self._drop(device)

    def obey(self, name: str, verb: str, who: str) -> tuple[bool, Sentence]:
        """Remove a device at a person's request; return whether it was removed, and the text of the reply.

        name: device id. verb: FORGET, or ERASE to delete its store entries too. who: the person. A device that still
        sends, or that the ward file or a bridge still lists, is not removed.
        """
        device = self._parts.devices.get(name)
        if (refusal := self._refusal(name, device)) is not None:
            return False, refusal
        if device is not None:
            device.session.silence((Code.FORGOTTEN(who=who),))
            device.say_status(self._parts.now_ns())  # the pages drop a device with this reason
            self._drop(device)
        self._clear(name, verb)
        return True, Code.ERASED(who=who) if verb == ERASE else Code.FORGOTTEN(who=who)

    def overhear(self, key: keys.Key) -> None:
        """Drop this estimator's copies of a device when another estimator answers a FORGET or ERASE command.

        key: bus key of the command; contains device id and verb.
        """
        verb = key.ids["verb"]
        if verb in (FORGET, ERASE) and self._refusal(key.device, self._parts.devices.get(key.device)) is None:
            self._clear(key.device, verb)

    def _refusal(self, name: str, device: Device | None) -> Sentence | None:
        if self._gate.lists(name):
            return Code.STILL_LISTED(device=name, place="[devices]")
        if bridge := self._parts.devices.listed_by(name, self._presence.alive):
            return Code.STILL_LISTED(device=name, place=bridge)
        since = time.monotonic() - self._parts.settings.silence_s
        sends = self._parts.cluster.replay.heard(name, since) if device is None else not device.session.life.away
        return Code.STILL_SENDING(device=name) if sends else None

    def _drop(self, device: Device) -> None:
        for alert in device.board.standing:
            self._parts.record.alert(device.name, Change(alert, cleared=True))
        self._checks.remove([device])
        device.close()
        self._clear(device.name, FORGET)

    def _clear(self, name: str, verb: str) -> None:
        """Drop copies of a device's state, from which it would be continued; and its entries in the store, if asked to."""
        self._parts.cluster.replicas.forget(name)
        self._parts.cluster.replay.forget(name)
        if verb == ERASE:
            self._parts.record.erase(name)
