"""When a device is lost: nothing that can be used has come of it for too long; and why, in words."""

import logging

from estimator.lifecycle import Event
from estimator.service.device import Device
from estimator.service.gate import Gate
from estimator.service.presence import SETTLED_S, Presence
from estimator.service.turns import Turns

log = logging.getLogger(__name__)

#: who has something set aside is not silent, for so long: it may be what is only said again; of hundreds of devices that are
#: brought up to now after a restart the last waits longer
ASIDE_S, PAST_S = 10.0, 60.0
_OUTDATED = "its samples are refused as old: was the clock of bridge {bridge} set back, or is a recording played?"


class Lost:
    """Times are monotonic seconds."""

    def __init__(self, presence: Presence, gate: Gate, turns: Turns, silence_s: float) -> None:
        self._presence, self._gate, self._turns, self._silence_s = presence, gate, turns, silence_s

    def look(self, device: Device, now: float, waited_s: float) -> None:
        """Once a second. waited_s: what it sent may wait unread, or be set aside: that we do not keep up is nobody's silence."""
        silent_s = now - device.heard - waited_s
        if self._turns.waits(device.key) and silent_s < (PAST_S if self._turns.of_the_past(device.key) else ASIDE_S):
            silent_s = 0.0
        if silent_s <= min(self._silence_s, SETTLED_S):
            return
        which = device.name, device.session.boot or 0, device.source.owner
        if silent_s > self._silence_s or (silent_s > SETTLED_S and self._presence.gone(*which, now)):
            self._lose(device, now)

    def _lose(self, device: Device, now: float) -> None:
        name, owner = device.name, device.source.owner
        boot, outdated_s = device.outdated
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
