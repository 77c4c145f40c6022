"""Reports what a device's samples led to: logged, stored and published; and which devices have a block to learn from."""

import logging
import time

from estimator.device.outcome import Outcome
from estimator.service.device import Device
from estimator.service.parts import Parts
from estimator.service.window_views import WindowViews

log = logging.getLogger(__name__)


class Outcomes:
    """Reporter of outcomes of the devices' sessions."""

    def __init__(self, parts: Parts, views: WindowViews) -> None:
        self._parts, self._views = parts, views
        #: devices with a whole block to learn from, in order
        self.to_learn = dict[str, None]()

    def tell(self, device: Device, outcome: Outcome) -> None:
        """Report an outcome, and note whether the device has a block to learn from."""
        for words in outcome.said:
            log.info("%s: %s", device.name, words)
        for made in outcome.calibrations:
            if device.session.calibration is made:
                device.repeated = None
            self._parts.record.calibration(device, made, time.monotonic())
        if outcome.seconds:
            self._views.take(device, outcome.seconds)
        for revision in outcome.revisions:
            device.say_revision(revision)
        if outcome.changed:
            device.say_status(self._parts.now_ns())
            if device.session.learnt.turned:
                self._parts.cluster.tell(device)  # the other estimators must know that turns would be lost with us
        if device.session.to_learn:
            self.to_learn[device.name] = None

    def learn(self, device: Device) -> None:
        """Learn from a device's whole block, if one waits."""
        if device.session.to_learn:
            self.tell(device, device.session.learn())
