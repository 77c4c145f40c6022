"""Reporter of processing results: logs, stores and publishes them, and publishes window summaries for viewers."""

import logging
import time

from bridge.bus.contract import BusError
from bridge.wire import codec
from estimator.device.outcome import Outcome
from estimator.device.window_summary import Second, windows
from estimator.service.device import Device
from estimator.service.parts import Parts

log = logging.getLogger(__name__)

#: device blocks whose summaries failed are counted under this name
FAILED = "windows failed"


class Outcomes:
    """Reporter of the outcomes of devices' sessions: logs, stores and publishes them.

    `to_learn`: ids of devices with a finished block of samples that no estimate has used yet, in order.
    """

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        #: finished blocks of samples, about a second each, to be summarised for viewers
        self._blocks: list[tuple[Device, Second]] = []
        #: devices with a whole block to learn from, in order
        self.to_learn = dict[str, None]()

    def tell(self, device: Device, outcome: Outcome) -> None:
        """Report an outcome: log its lines, store and publish calibrations, publish revisions and a changed status.

        If the device has a finished block of samples that no estimate has used yet, its id is added to `to_learn`.
        """
        for words in outcome.said:
            log.info("%s: %s", device.name, words)
        for made in outcome.calibrations:
            if device.session.calibration is made:
                device.repeated = None
            self._parts.record.calibration(device, made, time.monotonic())
        self._blocks += [(device, block) for block in outcome.seconds]
        for revision in outcome.revisions:
            device.say_revision(revision)
        if outcome.changed:
            device.say_status(self._parts.now_ns())
            if device.session.learnt.turned:
                self._parts.cluster.tell(device)  # the other estimators must know that turns would be lost with us
        if device.session.to_learn:
            self.to_learn[device.name] = None

    def learn(self, device: Device) -> None:
        """Update a device's bias and calibration from its finished block of samples, and report the outcome.

        Does nothing if no finished block waits.
        """
        if device.session.to_learn:
            self.tell(device, device.session.learn())

    def say_windows(self) -> None:
        """Publish window summaries (statistics over 0.1 s) of the blocks of samples that have been finished.

        Called once a round of the run loop. A failure is logged and counted; only BusError is raised.
        """
        due, self._blocks = self._blocks, []
        if not due:
            return
        try:
            for (device, _), batch in zip(due, windows([block for _, block in due]), strict=True):
                device.say("@windowed", codec.encode_windows(batch))
        except BusError:
            raise  # a lost bus concerns all devices
        except Exception:  # any failure is contained: viewers must not stop the correction
            if self._parts.counts.add(FAILED, len(due)) == len(due):
                log.exception("window summaries could not be computed (further failures are counted, not logged)")
