"""Fault isolation: work that fails costs its own device its session, and each sample at stake is counted."""

import logging
from collections.abc import Callable
from typing import TypeVarTuple

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.service.device import Counted, Device

Ts = TypeVarTuple("Ts")

log = logging.getLogger(__name__)

FAILED = "session failed"


class FaultIsolation:
    """Does work of one device and goes on with the others whatever comes of it; `counts` are the ward's."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts

    def __call__(self, device: Device, work: Callable[[*Ts], object], *args: *Ts, came: int = 0) -> bool:
        """Whether work(*args) went well; else the device's session begins anew. came: see `failed`."""
        before = device.counted
        try:
            work(*args)
        except Exception as error:  # noqa: BLE001 - of whatever kind: see `failed`
            self.failed(device, error, before, came=came)
            return False
        return True

    def failed(self, device: Device, error: Exception, before: Counted, *, came: int = 0) -> None:
        """Work of a device has: its session begins anew. The service of all others must not end with it.

        came: samples that the work was to take in.
        """
        if isinstance(error, BusError):
            raise error  # the bus itself is gone: for all
        held, samples_in, samples_out, told = before
        sequence = device.session.sequence
        uncounted = held + came - (sequence.samples_in - samples_in)
        unsaid = sequence.samples_out - samples_out - (device.told - told)
        device.restart(lost=unsaid, uncounted=max(0, uncounted))
        self._counts.add("sessions failed")
        if device.session.count_event(FAILED) == 1:
            words = "%s: its session failed and begins anew (more of this device are only counted)"
            log.error(words, device.name, exc_info=error)
