"""Start of devices in this estimator: new, resumed after an orderly stop, or continued from another's checkpoint."""

import logging
from collections.abc import Callable

from bridge.reasons.catalogue import english
from bridge.wire.messages import Checkpoint
from estimator.config.device_settings import Treatment, treatment
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import changed
from estimator.samples.sample_buffer import Samples
from estimator.service.boot_start import Boots
from estimator.service.checkpoints import calibrated
from estimator.service.device import NEWCOMER_S, Device
from estimator.service.parts import Parts
from estimator.service.replay_log import Resumed

log = logging.getLogger(__name__)


class DeviceStarts:
    """Puts devices into the roster.

    resumed: what was reached before a restart. tell: reports a session's outcome. listed: a `[devices]` list names all devices.
    """

    def __init__(
        self, parts: Parts, boots: Boots, resumed: Resumed, tell: Callable[[Device, Outcome], None], *, listed: bool
    ) -> None:
        self._listed = listed
        self._parts, self._boots, self._resumed, self._tell = parts, boots, resumed, tell
        self._treatment = treatment(parts.settings)

    def use(self, treatment: Treatment) -> None:
        """Use other settings: for new devices at once, for known ones from their next boot or calibration on."""
        self._treatment = treatment
        for device in self._parts.devices.values():
            device.use(treatment.of(device.name))

    def begin(self, batch: Samples, now: float) -> Device | None:
        """Create a device from its first batch; None where there is no room.

        The bridge known to another estimator, or from before a restart, becomes the owner. A boot stopped in order is
        resumed.
        """
        devices, cluster = self._parts.devices, self._parts.cluster
        if not devices.room(now, batch.n):
            return None
        name = batch.device
        device = self._made(name, now, batch.first_s)
        lately = cluster.replicas.lately_from(name, self._parts.now_ns())
        if known := lately or self._resumed.bridge(name, batch.receive_time_ns):
            device.admission.owns(known, now)
        devices[name] = device
        if (stopped := self._parts.record.stopped(name, batch.boot)) is not None and self._goes_on(device, stopped):
            self._resume(device)
        return device

    def take_over(self, name: str, now: float) -> Device | None:
        """Take over a device from its checkpoint; without a usable one it starts with its first sample, and is None."""
        devices, known = self._parts.devices, self._parts.cluster.replicas.of(name)
        if known is None or not known.state or not devices.room(now, 0):
            return devices.get(name)
        device = self._made(name, now)
        if self._parts.record.holds(device, known) and self._goes_on(device, known):
            device.heard = now - max(0.0, (self._parts.now_ns() - known.time_ns) / 1e9)
            if known.bridge:
                device.admission.owns(known.bridge, device.heard)
            devices[name], session = device, device.session
            self._resumed.taken(name, session.boot or 0, session.sequence.next or 0, session.last_heard_ns, now)
            self._parts.guarded(device, self._resume, device)
        return devices.get(name)

    def adopt(self, known: Checkpoint) -> None:
        """Adopt a calibration that another estimator made during a network partition, so that no turns are repeated."""
        device, calibration = self._parts.devices.get(known.device), calibrated(known)
        if device is None or calibration is None:
            return
        session, record = device.session, self._parts.record
        if session.boot != calibration.boot or session.calibration is not None:
            return
        changed_since = session.info is not None and changed(calibration, session.info, within_boot=True)
        if changed_since or record.of_before(device, calibration):
            return

        def adopted() -> None:
            device.repeated = None
            session.adopt(PriorKnowledge(calibration, None), calibration)
            log.info("%s: %s", device.name, english(*session.life.reason))
            record.keep(device, calibration)
            device.say_status(self._parts.now_ns())

        self._parts.guarded(device, adopted)

    def _made(self, name: str, now: float, began: float = 0.0) -> Device:
        """Create a device owned by us. began: device time in s of the start of its boot, if known."""
        parts = self._parts
        knobs, epoch = self._treatment.of(name), parts.cluster.epoch(name)
        device = Device(parts.bus, parts.ward, name, knobs, parts.settings.silence_s, now, epoch, began, parts.alerts)
        device.stands(parts.record.standing(name), now)
        known = self._listed or parts.record.knows(name) or parts.cluster.replicas.of(name) is not None
        device.announced_after_s = 0.0 if known else NEWCOMER_S
        device.placement = parts.record.placement(name)
        if device.placement is None and (worn := parts.settings.placements.get(name)) is not None:
            device.placement = worn.placement
        return device

    def _goes_on(self, device: Device, known: Checkpoint) -> bool:
        """Whether a device continues from a checkpoint; a damaged checkpoint changes nothing and is counted."""
        try:
            device.take_over(known)
        except Exception as error:  # noqa: BLE001 - a checkpoint may hold anything, and all devices are at stake
            log.warning("%s: its checkpoint is not used: %s", device.name, error)
            self._parts.counts.add("checkpoint messages refused, damaged")
            return False
        return True

    def _resume(self, device: Device) -> None:
        used = device.session.calibration
        log.info("%s: %s of this boot restored", device.name, "bias" if used is None else f"calibration {used.id}")
        if (outcome := self._boots.resumed(device)) is not None:
            self._tell(device, outcome)
