"""Checkpoints and claims of estimators, so that any of them can go on with any device. Pure."""

from collections.abc import Iterator
from dataclasses import replace

from bridge.wire.cluster_messages import MAX_ANSWERS
from bridge.wire.messages import Calibration, Checkpoint, CommandReply, DeviceInfo
from estimator.device.restore_key import differing, restore_key
from estimator.service.device import Device

#: a checkpoint is said every five seconds of a device that is heard
LATELY_NS = 10_000_000_000


Answers = tuple[tuple[str, CommandReply], ...]


def checkpoint_of(device: Device, time_ns: int, answers: Answers = ()) -> Checkpoint | None:
    """What another would need of a device, and what its last commands were answered; None before it has a boot."""
    session = device.session
    if session.boot is None:
        return None
    used = session.calibration or session.prior
    state = session.state() or b""
    if session.calibration is None and used is not None and used.boot == session.boot:
        used, state = None, b""  # of another power-up under this number: who restores it would take it for this one's
    return Checkpoint(
        device.name,
        session.boot,
        device.epoch,
        time_ns,
        device.admission.source.owner,
        used,
        answers,
        device.repeated == session.boot,
        state,
    )


def calibrated(checkpoint: Checkpoint) -> Calibration | None:
    """The calibration of its own boot, if it has one."""
    used = checkpoint.calibration
    return used if used is not None and used.boot == checkpoint.boot else None


class Checkpoints:
    """The latest checkpoint of a bounded number of devices, and what their last commands were answered, by whomever."""

    def __init__(self, devices: int) -> None:
        self._room = devices
        self._latest: dict[str, Checkpoint] = {}
        self._answers: dict[str, Answers] = {}

    def note(self, checkpoint: Checkpoint) -> None:
        """Keep it, unless a later turn has said something of the device; what is of one turn comes in order."""
        self.answer(checkpoint.device, checkpoint.answers)
        known = self._latest.get(checkpoint.device)
        if known is not None and checkpoint.epoch < known.epoch:
            # Who did not know yet that the device was another's may have calibrated it meanwhile.
            of_it = known.boot == checkpoint.boot and not known.boot_repeated
            if not of_it or calibrated(known) or not calibrated(checkpoint):
                return
            checkpoint = replace(known, calibration=checkpoint.calibration, state=b"")
        self._latest.pop(checkpoint.device, None)
        self._latest[checkpoint.device] = checkpoint
        while len(self._latest) > self._room:
            del self._latest[next(iter(self._latest))]

    def __iter__(self) -> Iterator[Checkpoint]:
        return iter(self._latest.values())

    def answer(self, device: str, given: Answers) -> None:
        """Keep what commands were answered."""
        if given:
            known = self._answers.pop(device, ())
            self._answers[device] = (*(one for one in known if one not in given), *given)[-MAX_ANSWERS:]
            while len(self._answers) > self._room:
                del self._answers[next(iter(self._answers))]

    def answers(self, device: str) -> Answers:
        """What its last commands were answered, oldest first."""
        return self._answers.get(device, ())

    def of(self, device: str) -> Checkpoint | None:
        """The latest of a device."""
        return self._latest.get(device)

    def bridge(self, device: str) -> str:
        """Whom it was heard from; empty where nothing was said of it."""
        known = self._latest.get(device)
        return "" if known is None else known.bridge

    def lately_from(self, device: str, now_ns: int) -> str:
        """The same, while it most likely is: one that has been silent since may be anywhere."""
        known = self._latest.get(device)
        return known.bridge if known is not None and abs(now_ns - known.time_ns) <= LATELY_NS else ""

    def calibration(self, device: str, boot: int) -> Calibration | None:
        """The calibration that was said of this very boot."""
        known = self._latest.get(device)
        return None if known is None or known.boot != boot else calibrated(known)

    def repeated(self, device: str, boot: int) -> bool:
        """Whether this very boot has a number that another power-up had, and was not calibrated."""
        known = self._latest.get(device)
        return known is not None and known.boot == boot and known.boot_repeated and not calibrated(known)

    def forget(self, device: str) -> None:
        """We know better of a device of ours than anybody has said of it."""
        self._latest.pop(device, None)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """The calibration last said of the same hardware, of an earlier boot."""
        known = self._latest.get(info.device)
        used = None if known is None else known.calibration
        if used is None or used.boot == info.boot or differing(restore_key(used), info):
            return None
        return used
