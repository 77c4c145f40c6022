"""Sample intake: decodes the messages of one round, admits each batch in turn, corrects all together, publishes."""

import logging
import time
from collections.abc import Callable, Sequence

from bridge.bus.contract import Message
from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import english
from bridge.wire import codec, keys
from bridge.wire.refusal import Refusal
from estimator.device.admission import BEGINS, Ruling
from estimator.device.batch_correction import Cut, correct
from estimator.device.orientation import oriented
from estimator.device.outcome import Outcome
from estimator.samples.sample_buffer import Samples
from estimator.service.boot_start import Boots
from estimator.service.decode import decode
from estimator.service.device import Device
from estimator.service.device_start import DeviceStarts
from estimator.service.parts import Parts
from estimator.service.periodic_checks import PeriodicChecks
from estimator.service.replay_log import DONE, Resumed

log = logging.getLogger(__name__)


class Intake:
    """Pipeline from the sample messages of the roster's devices to their publishers.

    tell(device, outcome): reports results other than corrected rates, such as calibrations.
    """

    def __init__(
        self,
        parts: Parts,
        boots: Boots,
        checks: PeriodicChecks,
        resumed: Resumed,
        tell: Callable[[Device, Outcome], None],
        starts: DeviceStarts,
    ) -> None:
        self._devices, self._boots = parts.devices, boots
        self._resumed, self._counts = resumed, parts.counts
        self._say, self._starts, self._came = tell, starts, checks.came
        #: samples to correct and publish in this round, in order; devices with samples that could not be published
        self._due: list[tuple[Device, Cut]] = []
        self._unsaid: list[tuple[Device, Exception]] = []

    def take(self, messages: Sequence[Message]) -> None:
        """Decode, correct and publish the sample messages of one round of the run loop.

        Refused messages are counted. A failure in one device's work restarts only that device's session.
        """
        now, came = time.monotonic(), 0
        resumed = self._resumed.lasts(now)
        for message, samples in zip(messages, decode(messages), strict=True):
            if isinstance(samples, Refusal):
                self._refuse("sample", message.key, samples)
                continue
            came += samples.n
            if resumed and self._resumed.done(samples):
                self._counts.add(DONE, samples.n)
                continue
            self._on_samples(message.key, samples, now)
        self._came(came)
        self._publish()
        while self._unsaid:  # only now, when no batch is under way
            self._devices.failed(*self._unsaid.pop())

    def hear(self, message: Message) -> None:
        """Process a bridge's device info message: keep the info, and apply it if it belongs to the present boot.

        If the info contains a calibration that the device made itself, the calibration is offered to the session.
        """
        try:
            info = codec.decode_info(*message)
        except Refusal as refusal:
            self._refuse("info", message.key, refusal)
            return
        before = self._devices.info(info.bridge, info.device)
        self._devices.note(info)
        device = self._devices.get(info.device)
        if device is None or device.admission.owner != info.bridge or device.session.boot != info.boot:
            return

        def introduced() -> None:
            if (outcome := self._boots.introduced(device, info, before)) is not None:
                self._tell(device, outcome)
            if info.calibration is not None and device.announced:  # a refusal could not be published before
                self._tell(device, device.session.offered(info.calibration, time.time_ns()))

        self._devices.guard(device, introduced)

    def _refuse(self, what: str, key: str, refusal: Refusal) -> None:
        """Count a refused message by its reason, in the ward's counts and with its device; the first is logged."""
        if self._counts.add(f"{what} messages refused, {refusal.reason}") == 1:
            log.warning(
                "one %s message was refused: %s (further ones of this kind are counted, not logged)", what, refusal
            )
        try:
            device = self._devices.get(keys.parse(key).ids.get("device", ""))
        except Refusal:
            device = None
        if device is not None:
            device.session.count_event(f"refused {refusal.reason}")

    def _on_samples(self, key: str, samples: Samples, now: float) -> None:
        device = self._devices.get(samples.device) or self._starts.begin(samples, now)
        if device is None:
            return
        if device.admission.owns(samples.bridge, now):
            device.key = key
            device.came += samples.n
            self._devices.guard(device, self._take, device, samples, now)
            return
        if device.session.sequence.events.add(device.admission.label(samples.bridge, now), samples.n) == samples.n:
            # The number of such samples stands in the device's status.
            log.warning(
                "%s (logged once)",
                english(duplicate_bridges.said([samples.device], device.admission.owner, (samples.bridge,))),
            )

    def _take(self, device: Device, batch: Samples, now: float) -> None:
        ruling = device.admission.judge(batch, now)
        if ruling is Ruling.LATE:
            return  # a repeat is no sign of life: it may come from a recording
        device.heard = now
        if ruling is Ruling.RANGE:
            if device.session.count_event("sample number jump refused") == 1:
                log.warning(
                    "%s: sample number %d is refused: it is too far from the earlier numbers",
                    device.name,
                    batch.sequence,
                )
            return
        if ruling in BEGINS:
            self._publish()  # publish the samples of the boot before
            self._tell(device, self._boots.begin(device, batch, same=ruling is not Ruling.REPEAT))
        session = device.session
        if session.sequence.next is None and (session.boot is None or session.begins_earlier(batch)):
            self._boots.begin(device, batch)
        cuts = list[Cut]()
        if (outcome := session.take(batch, cuts)) is not None:
            self._tell(device, outcome)
        for cut in cuts:
            device.told += cut.n
            self._due.append((device, cut))

    def _tell(self, device: Device, outcome: Outcome) -> None:
        """Report an outcome after the samples that caused it and before the first sample that it affects."""
        if outcome.worded:
            self._publish()
        self._say(device, outcome)

    def _publish(self) -> None:
        """Correct all due samples together and publish them in order, then the orientations that somebody wants."""
        due, self._due = self._due, []
        for (device, cut), rates in zip(due, correct([cut for _, cut in due]), strict=True):
            try:
                device.say_corrected(cut, rates)
            except Exception as error:  # noqa: BLE001 - any failure is contained: see `failed`
                device.told -= cut.n
                self._unsaid.append((device, error))
        turning = [(attitude, cut) for device, cut in due if (attitude := device.session.attitude) is not None]
        for one in oriented(turning):
            if (turned := self._devices.get(one.cut.samples.device)) is not None:
                turned.say_orientation(one)
