"""Device loss: detects devices without a usable sample for too long, and finds the reason."""

import logging
from collections.abc import Container

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from estimator.device.attention import ended
from estimator.device.lifecycle import Event
from estimator.service.device import Device
from estimator.service.device_roster import DeviceRoster
from estimator.service.enrolment_gate import EnrolmentGate
from estimator.service.presence import SETTLED_S, Presence

log = logging.getLogger(__name__)

#: reason given for a device that has sent nothing since it was taken over
SILENT = (Code.NO_SAMPLES_SINCE_TAKEOVER(),)


class DeviceLoss:
    """Detector of lost devices: devices without a usable sample for more than `silence_s` seconds.

    waiting: bus keys whose messages are not processed yet; the devices of these keys are not taken for lost.
    """

    def __init__(
        self,
        devices: DeviceRoster,
        presence: Presence,
        gate: EnrolmentGate,
        waiting: Container[str],
        silence_s: float,
    ) -> None:
        self._devices = devices
        self._presence, self._gate, self._waiting, self._silence_s = presence, gate, waiting, silence_s

    def look(self, device: Device, now: float) -> None:
        """Check one device; if it has been silent for too long, mark its session as lost and log why.

        Called once a second. now: monotonic time, s.
        The limit is a silence of `silence_s` seconds. SETTLED_S seconds are enough if a live bridge withdrew the
        device's liveliness token at least SETTLED_S seconds ago.
        """
        silent_s = now - device.heard
        if silent_s <= min(self._silence_s, SETTLED_S) or device.key in self._waiting:
            return
        which = device.name, device.session.boot or 0, device.admission.owner
        if silent_s > self._silence_s or self._presence.gone(*which, now):
            self._lose(device, now)

    def _lose(self, device: Device, now: float) -> None:
        name, owner = device.name, device.admission.owner
        boot, outdated_s = device.admission.outdated
        speaks = device.heard < outdated_s and now - outdated_s <= self._silence_s
        if speaks and self._presence.heard(name, boot, owner):
            if device.session.silence((Code.SAMPLES_OUTDATED(bridge=owner),), Event.OUTDATED):
                log.warning("%s: %s", name, english(*device.session.life.reason))
            return
        info = self._devices.info(owner, name)
        if info is not None and ended(info.trouble):
            if device.session.silence(info.trouble):
                log.info("%s: %s", name, english(*info.trouble))
            return
        why = self._gate.why(name, owner) or self._presence.why(name, device.session.boot or 0, owner)
        reason = (Code.NO_SAMPLES(duration=_lasting(now - device.heard)), *why)
        if device.session.silence(reason):
            log.warning("%s: lost, %s", name, english(*reason))


def _lasting(seconds: float) -> str:
    if seconds >= 7200:
        return f"{seconds / 3600:.0f} h"
    return f"{seconds / 60:.0f} min" if seconds >= 120 else f"{seconds:.1f} s"
