"""One device's fault is not another's: work that fails costs its device its session, and each sample at stake is counted."""

import logging
from collections.abc import Callable
from typing import TypeVarTuple

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.service.device import Device

Ts = TypeVarTuple("Ts")

log = logging.getLogger(__name__)

FAILED = "session failed"


class Isolation:
    """Does work of one device and goes on with the others whatever comes of it; `counts` are the ward's."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts

    def __call__(self, device: Device, work: Callable[[*Ts], object], *args: *Ts, came: int = 0, owed: int = 0) -> bool:
        """Whether work(*args) went well; else the device's session begins anew.

        came: samples that the work takes in. owed: samples that count as corrected, which the work is to publish.
        """
        sequence, held = device.session.sequence, device.overtaken.samples
        samples_in, samples_out, told = sequence.samples_in, sequence.samples_out, device.told
        try:
            work(*args)
        except BusError:
            raise  # the bus itself is gone: for all
        except Exception:  # of whatever kind: a fault in one device's session must not end the service of all others
            sequence = device.session.sequence
            uncounted = held + came - (sequence.samples_in - samples_in)
            unsaid = owed + sequence.samples_out - samples_out - (device.told - told)
            device.restart(lost=max(0, unsaid), uncounted=max(0, uncounted))
            self._counts.add("sessions failed")
            if device.session.count_event(FAILED) == 1:
                log.exception(
                    "%s: its session failed and begins anew (more of this device are only counted)", device.name
                )
            return False
        return True
