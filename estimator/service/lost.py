"""When a device is lost: nothing that can be used has come of it for too long; and why, in words."""

import logging
from collections.abc import Container

from estimator.lifecycle import Event
from estimator.service.device import Device
from estimator.service.gate import Gate
from estimator.service.presence import SETTLED_S, Presence

log = logging.getLogger(__name__)

#: why a device is lost that sends nothing since it was taken over
SILENT = "no samples since another estimator had it: is it switched on, plugged in, in reach?"
_OUTDATED = "its samples are refused as old: was the clock of bridge {bridge} set back, or is a recording played?"


class Lost:
    """Times are monotonic seconds. waiting: the keys of devices whose messages wait to be handled."""

    def __init__(self, presence: Presence, gate: Gate, waiting: Container[str], silence_s: float) -> None:
        self._presence, self._gate, self._waiting, self._silence_s = presence, gate, waiting, silence_s

    def look(self, device: Device, now: float) -> None:
        """Once a second."""
        silent_s = now - device.heard
        if silent_s <= min(self._silence_s, SETTLED_S) or device.key in self._waiting:
            return
        which = device.name, device.session.boot or 0, device.admission.source.owner
        if silent_s > self._silence_s or self._presence.gone(*which, now):
            self._lose(device, now)

    def _lose(self, device: Device, now: float) -> None:
        name, owner = device.name, device.admission.source.owner
        boot, outdated_s = device.admission.outdated
        speaks = device.heard < outdated_s and now - outdated_s <= self._silence_s
        if speaks and self._presence.heard(name, boot, owner):
            if device.session.silence(_OUTDATED.format(bridge=owner), Event.OUTDATED):
                log.warning("%s: %s", name, device.session.life.reason)
            return
        why = self._gate.words(name, owner) or self._presence.words(name, device.session.boot or 0, owner)
        reason = f"{_silent_for(now - device.heard)}{': ' if why else ''}{why}"
        if device.session.silence(reason):
            log.warning("%s: lost, %s", name, reason)


def _silent_for(seconds: float) -> str:
    if seconds >= 7200:
        return f"no samples for {seconds / 3600:.0f} hours"
    return f"no samples for {seconds / 60:.0f} minutes" if seconds >= 120 else f"no samples for {seconds:.1f} s"
