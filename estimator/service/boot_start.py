"""Start of a device's boot (the time from a power-up to the next): restores a stored calibration or says why not."""

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentences
from bridge.wire.messages import Calibration, DeviceInfo
from estimator.config.device_settings import treatment
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import changed, restore_key
from estimator.device.session_knobs import SessionKnobs
from estimator.noise.device_model import model_stated
from estimator.samples.sample_buffer import Samples
from estimator.service.device import Device
from estimator.service.parts import Parts

log = logging.getLogger(__name__)


class Boots:
    """Starter of device boots, with knowledge from the store and from other estimators' checkpoints.

    `treatment`: session settings by device and sensor model.
    """

    def __init__(self, parts: Parts) -> None:
        self._devices, self._record = parts.devices, parts.record
        #: settings of each device
        self.treatment = treatment(parts.settings)

    def begin(self, device: Device, batch: Samples, *, same: bool = True) -> Outcome:
        """Begin a boot of a device with its first batch of samples, and restore the stored calibration and bias.

        If no calibration of this boot is stored, the scale factors of an earlier boot serve as a prior.
        same: False if another power-up used this boot number before. Then a stored calibration serves only as a prior
        for the scale factors.
        Returns the outcome for `Outcomes.tell`: lines to log and messages to publish.
        """
        session, info = device.session, self._devices.info(batch.bridge, batch.device)
        device.use(self.knobs(device.name, batch.bridge))
        if batch.boot != device.repeated:
            device.repeated = None
        if session.boot is None and session.sequence.samples_in == 0:
            session.sequence.recall(partial(self._before, device.name, batch.boot))
        session.info = info = info if info is not None and info.boot == batch.boot else None
        remembered, scratch = self._record.recall(device, batch.boot), Sentences()
        if info is not None:
            self._record.boot(info)
            if remembered is not None and remembered.calibration is not None:
                scratch = changed(remembered.calibration, info, within_boot=True)
            if scratch:
                remembered = None
            if remembered is None or remembered.calibration is None:
                prior = self._record.earlier.prior(device, info)
                scratch = scratch if prior is None else ()
                remembered = _with(remembered, prior)
                if prior is None:
                    scratch = scratch or self._record.earlier.scratch(info)
        outcome = session.begin_boot(batch.boot, batch.first_s, remembered if same else None, None, batch.celsius)
        if not same:
            session.count_event("boot number repeated")
            self._record.repeat(device, batch.boot, *outcome.calibrations)
            if remembered is not None and remembered.calibration is not None:
                session.believe(remembered.calibration)
        if info is not None and scratch:
            outcome.said += self._from_scratch(device, info, scratch)
        if info is not None:
            self._look_up(device, info)
            outcome.said += self._noise_model(info)
        return outcome

    def knobs(self, device: str, bridge: str) -> SessionKnobs:
        """Return the session settings of a device for samples from this bridge.

        The sensor model is that of the ward file; if the file names none, the model that the device states.
        """
        info = self._devices.info(bridge, device)
        return self.treatment.of(device, info.model if info else "")

    def _noise_model(self, info: DeviceInfo) -> list[str]:
        stated = "" if self.treatment.told(info.device) else model_stated(info.model)
        return [f"noise model {stated}, from the device"] if stated else []

    def _before(self, name: str, boot: int) -> list[int] | None:
        """Boots before this one, oldest first; None while unreadable. A bridge's cache may start in an earlier boot."""
        device = self._devices.get(name)
        kept = None if device is None else self._record.earlier.past(name)
        return kept[: kept.index(boot)] if kept is not None and boot in kept else kept

    def introduced(self, device: Device, info: DeviceInfo, before: DeviceInfo | None) -> Outcome | None:
        """Apply a device info (identity and settings) just received from the bridge that owns the device.

        before: the bridge's previous info of the device, or None.
        Calibrations that do not match the new info are dropped. A matching calibration of an earlier boot is looked up
        as a prior.
        Returns the outcome for `Outcomes.tell`. Returns None if boot and restore key (model, firmware, range, rate) are
        unchanged.
        """
        session = device.session
        session.info = info
        device.use(self.treatment.of(device.name, info.model))
        if before is not None and before.boot == info.boot and restore_key(before) == restore_key(info):
            return None
        self._record.boot(info)
        outcome = Outcome()
        used = session.calibration or session.prior
        scratch = () if used is None else changed(used, info, within_boot=True)
        if scratch:
            outcome = session.start_over(scratch)
        if session.calibration is None:
            if (prior := self._record.earlier.prior(device, info)) is not None:
                session.learnt.scratch = scratch = ()
                session.believe(prior)
            else:
                scratch = scratch or self._record.earlier.scratch(info)
        if scratch:
            outcome.said += [words for words in self._from_scratch(device, info, scratch) if words not in outcome.said]
            outcome.changed = True
        self._look_up(device, info)
        return outcome

    def resumed(self, device: Device) -> Outcome | None:
        """Apply the latest device info to a session that continues from a checkpoint.

        Returns the outcome for `Outcomes.tell`; None if nothing changed or no info of this boot is known.
        """
        info = self._devices.info(device.admission.owner, device.name)
        device.session.sequence.recall(partial(self._before, device.name, device.session.boot or 0))
        return None if info is None or info.boot != device.session.boot else self.introduced(device, info, None)

    def _look_up(self, device: Device, info: DeviceInfo) -> None:
        """Look up temperature law and boot-to-boot scale change from earlier boots, and apply both when read."""

        def use(what: Callable[[], None]) -> None:
            if self._devices.get(device.name) is device and device.session.boot == info.boot:
                self._devices.guard(device, what)

        session = device.session
        self._record.earlier.law(session, info, lambda law: use(lambda: session.learnt.expect(law)) if law else None)
        self._record.earlier.moves(session, info, lambda moves: use(lambda: session.moves(moves)))

    def _from_scratch(self, device: Device, info: DeviceInfo, why: Sentences) -> list[str]:
        device.session.learnt.scratch = why
        self._record.started_over(info, why)
        return [english(*why)]


def _with(remembered: PriorKnowledge | None, prior: Calibration | None) -> PriorKnowledge | None:
    """Knowledge of this boot, with the calibration of an earlier boot as prior."""
    if prior is None:
        return remembered
    return PriorKnowledge(prior, None) if remembered is None else replace(remembered, calibration=prior)
