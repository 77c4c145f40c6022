"""Start of devices in this estimator: new, resumed after an orderly stop, or continued from another estimator."""

import logging
from collections.abc import Callable

from bridge.reasons.catalogue import english
from bridge.wire.messages import Checkpoint
from estimator.config.alerts import Alerts
from estimator.config.device_settings import treatment
from estimator.config.schema import Estimator
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
    """Starter of devices: creates them and puts them into the roster.

    resumed: by device, the last sample that was corrected before a restart of this estimator.
    tell(device, outcome): reports the outcome of a start. listed: whether a `[devices]` table of the ward file names
    all devices.
    """

    def __init__(
        self,
        parts: Parts,
        boots: Boots,
        resumed: Resumed,
        tell: Callable[[Device, Outcome], None],
        alerts: Alerts,
        *,
        listed: bool,
    ) -> None:
        self._listed = listed
        self._parts, self._boots, self._resumed, self._tell = parts, boots, resumed, tell
        self._alerts = alerts
        #: devices that were in the roster when this estimator ended: boot, last time there in ns, and bridge
        self._last_run = parts.record.last_run()

    def use(self, settings: Estimator, alerts: Alerts) -> None:
        """Apply changed settings: of alerts at once, of a session from its next boot or calibration on."""
        self._alerts, self._boots.treatment = alerts, treatment(settings)
        for device in self._parts.devices.values():
            device.use(self._boots.knobs(device.name, device.admission.owner), alerts)

    def begin(self, batch: Samples, now: float) -> Device | None:
        """Create a device from its first batch; None if the roster has no room.

        now: monotonic time, s.
        Samples are used from one bridge only, the owner. The owner is the bridge named in a recent checkpoint, else the
        bridge of the last run, else the bridge of this batch.
        If this estimator made an orderly stop during the same boot of the device, it continues the session saved there.
        """
        devices, cluster = self._parts.devices, self._parts.cluster
        if not devices.room(now, batch.n):
            return None
        name = batch.device
        device = self._made(name, now, batch.bridge, batch.first_s)
        lately = cluster.replicas.lately_from(name, self._parts.now_ns())
        if known := lately or self._resumed.bridge(name, batch.receive_time_ns):
            device.admission.owns(known, now)
        self._resume_stopped(device, batch.boot)
        return device

    def take_over(self, name: str, now: float) -> Device | None:
        """Continue a device from another estimator's checkpoint; return the device of this name in the roster, or None.

        now: monotonic time, s. Without a usable checkpoint or without room in the roster, nothing is created. The
        device then starts with its first sample.
        """
        devices, known = self._parts.devices, self._parts.cluster.replicas.of(name)
        if known is None or not known.state or not devices.room(now, 0):
            return devices.get(name)
        device = self._made(name, now, known.bridge)
        if self._parts.record.holds(device, known) and self._goes_on(device, known):
            self._was_heard(device, known.bridge, known.time_ns, now)
            devices[name] = device
            self._parts.devices.guard(device, self._resume, device)
        return devices.get(name)

    def miss(self, now: float, wanted: Callable[[str], bool]) -> None:
        """Add to the roster the devices of the last run that have sent nothing since the start; they can then become lost.

        now: monotonic s. wanted(device): whether a device is to be served.
        """
        devices, cluster = self._parts.devices, self._parts.cluster
        for name, (boot, seen_ns, bridge) in self._last_run.items():
            if name in devices or not (wanted(name) and cluster.membership.wants(name, now) and devices.room(now, 0)):
                continue
            device = self._made(name, now, bridge)
            device.announced_after_s = 0.0
            self._was_heard(device, bridge, seen_ns, now)
            self._resume_stopped(device, boot)
        self._last_run = {}

    def adopt(self, known: Checkpoint) -> None:
        """Adopt a calibration of the present boot from another estimator's checkpoint, so that no turns are repeated.

        Another estimator can make such a calibration during a network partition.
        Does nothing if the device is unknown, in another boot, calibrated already, or no longer matches the
        calibration.
        """
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

        self._parts.devices.guard(device, adopted)

    def _made(self, name: str, now: float, bridge: str, began: float = 0.0) -> Device:
        """Create a device owned by us. bridge: that sends it. began: device time in s of the start of its boot, if known."""
        parts = self._parts
        knobs, epoch = self._boots.knobs(name, bridge), parts.cluster.epoch(name)
        device = Device(
            parts.bus,
            parts.ward,
            name,
            knobs,
            parts.settings.silence_s,
            now,
            epoch,
            began,
            self._alerts,
            parts.troubles,
        )
        device.stands(parts.record.standing(name), now)
        known = self._listed or parts.record.knows(name) or parts.cluster.replicas.of(name) is not None
        device.announced_after_s = 0.0 if known else NEWCOMER_S
        device.placement = parts.record.placement(name)
        return device

    def _was_heard(self, device: Device, bridge: str, time_ns: int, now: float) -> None:
        """Note when a device was heard last, host time in ns, and from which bridge, empty if unknown."""
        device.heard = now - max(0.0, (self._parts.now_ns() - time_ns) / 1e9)
        if bridge:
            device.admission.owns(bridge, device.heard)

    def _resume_stopped(self, device: Device, boot: int) -> None:
        """Put a device into the roster; it continues a boot that this estimator saved at an orderly stop."""
        self._parts.devices[device.name] = device
        if (stopped := self._parts.record.stopped(device.name, boot)) is not None and self._goes_on(device, stopped):
            self._parts.devices.guard(device, self._resume, device)

    def _goes_on(self, device: Device, known: Checkpoint) -> bool:
        """Return whether a device continues from a checkpoint; a damaged checkpoint changes nothing and is counted."""
        try:
            device.take_over(known)
        except Exception as error:  # noqa: BLE001 - a checkpoint may hold anything, and all devices are at stake
            log.warning("%s: the device continues without its checkpoint, which cannot be used: %s", device.name, error)
            self._parts.counts.add("checkpoint messages refused, damaged")
            return False
        return True

    def _resume(self, device: Device) -> None:
        used = device.session.calibration
        log.info(
            "%s: the %s of this boot was restored", device.name, "bias" if used is None else f"calibration {used.id}"
        )
        if (outcome := self._boots.resumed(device)) is not None:
            self._tell(device, outcome)
