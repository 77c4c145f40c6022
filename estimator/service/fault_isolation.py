"""Fault isolation: failing work resets the session of its own device only, and every affected sample is counted."""

import logging
from collections.abc import Callable
from typing import TypeVarTuple

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.service.device import Device

Ts = TypeVarTuple("Ts")

log = logging.getLogger(__name__)

#: event of a device whose session ended by an error
FAILED = "session failed"


class FaultIsolation:
    """Runs work of one device and contains its exceptions, except BusError. counts: the ward's counts."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts

    def __call__(self, device: Device, work: Callable[[*Ts], object], *args: *Ts) -> bool:
        """Run work(*args) and return whether it succeeded; a failure restarts the session."""
        try:
            work(*args)
        except Exception as error:  # noqa: BLE001 - any failure is contained: see `failed`
            self.failed(device, error)
            return False
        return True

    def failed(self, device: Device, error: Exception) -> None:
        """Restart the session of a device whose work failed, so that the other devices' service goes on.

        The device's samples that came and were not published are lost and counted. Raises the error again if it is a
        BusError, since a lost bus concerns all devices.
        """
        if isinstance(error, BusError):
            raise error
        device.restart()
        self._counts.add("sessions failed")
        if device.session.count_event(FAILED) == 1:
            words = (
                "%s: an error ended the device's session, and a new session starts (further errors are only counted)"
            )
            log.error(words, device.name, exc_info=error)
