"""Takeover of devices between estimators: releases devices to a new owner, and continues those of another estimator."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from bridge.bus.contract import Message, Publisher
from estimator.service.device import Device
from estimator.service.device_loss import SILENT
from estimator.service.device_start import DeviceStarts
from estimator.service.parts import Parts
from estimator.service.periodic_checks import PeriodicChecks
from estimator.service.quota import Quotas
from estimator.service.replay_log import since

#: how long publishers of a device lost to another estimator stay open for late queries, s
LINGER_S = 40.0


class Takeover:
    """Mover of devices between this estimator and the others.

    learn(device): updates a device's estimates from its last finished block of samples before the device leaves.
    """

    def __init__(
        self,
        parts: Parts,
        starts: DeviceStarts,
        checks: PeriodicChecks,
        quotas: Quotas,
        learn: Callable[[Device], None],
    ) -> None:
        self._parts, self._starts, self._checks, self._quotas, self._learn = parts, starts, checks, quotas, learn
        self._left = deque[tuple[float, Publisher]]()

    def look(self, now: float, *, heard: bool) -> None:
        """Process the other estimators' messages, and release the devices that they have taken over.

        Called once a round of the run loop. now: monotonic time, s. heard: True if samples arrived in this round; while
        nothing arrives, no other estimator counts as dead.
        An earlier owner may have calibrated a device that is held here now. The device adopts this calibration if it
        has none in this boot.
        """
        cluster = self._parts.cluster
        if lost := cluster.look(now, heard=heard):
            self._give_away(lost, now)
        if cluster.came:
            for device in self._parts.devices.values():
                device.checkpoint_due = now  # the newcomer holds off until it has heard of all devices
        for known in cluster.calibrated:
            self._starts.adopt(known)

    def take(self, others: Mapping[str, Sequence[Message]], now: float) -> list[Message]:
        """Take over the devices that this estimator should own now.

        Returns their sample messages still to be processed.
        others: messages of this round by device, of devices that this estimator does not hold. now: monotonic s.
        """
        ours = list[Message]()
        if not (taken := self._parts.cluster.take(others, now)):
            return ours
        self._parts.cluster.say(self._parts.devices, now)
        for name, backlog in taken.items():
            going_on = self._starts.take_over(name, now)
            if going_on is None:
                ours += backlog
            elif backlog:
                ours += since(backlog, going_on.session.boot or 0, going_on.session.sequence.next or 0)
            else:
                going_on.session.silence(SILENT)
        return ours

    def tidy(self, now: float) -> None:
        """Close the publishers of devices given away more than LINGER_S seconds before `now`, monotonic s.

        If `now` is inf, all are closed.
        """
        while self._left and self._left[0][0] <= now:
            self._left.popleft()[1].close()

    def _give_away(self, names: list[str], now: float) -> None:
        """Release devices taken by another estimator, which continues from our checkpoint."""
        self._quotas.drop(names)  # the new owner has these messages in its replay log
        leaving = [device for name in names if (device := self._parts.devices.get(name)) is not None]
        for device in leaving:
            self._parts.devices.guard(device, self._learn, device)
            self._parts.devices.guard(device, partial(self._parts.record.checkpoint, device, now, force=True))
        self._checks.remove(leaving)
        self._left += [(now + LINGER_S, publisher) for device in leaving for publisher in device.leave()]
