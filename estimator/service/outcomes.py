"""Reports what a device's samples led to: logged, stored and published; and window summaries for viewers."""

import logging
import time
from collections.abc import Sequence

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.device.outcome import Outcome
from estimator.device.window_summary import Second, windows
from estimator.service.device import Device
from estimator.service.parts import Parts

log = logging.getLogger(__name__)

#: device blocks whose summaries failed are counted under this name
FAILED = "windows failed"


class WindowViews:
    """Queue of finished blocks of samples (about a second each), published as window summaries for viewers.

    counts: the ward's counts.
    """

    def __init__(self, counts: Tally) -> None:
        self._counts = counts
        self._waiting: list[tuple[Device, Second]] = []

    def take(self, device: Device, seconds: Sequence[Second]) -> None:
        """Queue the finished blocks of a device."""
        self._waiting.extend((device, second) for second in seconds)

    def say(self) -> None:
        """Publish the summaries of the queued blocks, once a round of the run loop.

        A failure is logged and counted; only BusError is raised.
        """
        due, self._waiting = self._waiting, []
        if not due:
            return
        try:
            for (device, _), batch in zip(due, windows([second for _, second in due]), strict=True):
                device.say_windows(batch)
        except BusError:
            raise  # a lost bus concerns all devices
        except Exception:  # any failure is contained: viewers must not stop the correction
            if self._counts.add(FAILED, len(due)) == len(due):
                log.exception("windows could not be made (more are only counted)")


class Outcomes:
    """Reporter of what the devices' sessions made of their samples: logs, stores and publishes it."""

    def __init__(self, parts: Parts, views: WindowViews) -> None:
        self._parts, self._views = parts, views
        #: devices with a whole block to learn from, in order
        self.to_learn = dict[str, None]()

    def tell(self, device: Device, outcome: Outcome) -> None:
        """Report an outcome: log its lines, store and publish its calibrations, publish revisions and a changed status.

        A device whose finished block still has to be learnt from is added to `to_learn`.
        """
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
        """Let a device's session learn (update bias and calibration) from its finished block, if one waits."""
        if device.session.to_learn:
            self.tell(device, device.session.learn())
