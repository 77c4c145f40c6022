"""Checkpoints and ownership claims of estimators, so that any estimator can continue any device. Pure."""

from collections.abc import Iterator
from dataclasses import replace

from bridge.wire.cluster_messages import MAX_ANSWERS
from bridge.wire.messages import Calibration, Checkpoint, CommandReply, DeviceInfo
from estimator.device.restore_key import differing, restore_key
from estimator.service.device import Device

#: age up to which a checkpoint's bridge is trusted, ns; an active device is checkpointed every five seconds
LATELY_NS = 10_000_000_000


Answers = tuple[tuple[str, CommandReply], ...]


def checkpoint_of(device: Device, time_ns: int, answers: Answers = ()) -> Checkpoint | None:
    """Checkpoint of a device for the other estimators, with its last command replies; None before its first boot."""
    session = device.session
    if session.boot is None:
        return None
    used = session.calibration or session.prior
    state = session.state() or b""
    if session.calibration is None and used is not None and used.boot == session.boot:
        used, state = None, b""  # of another power-up under this boot number: the receiver would take it for this one's
    return Checkpoint(
        device.name,
        session.boot,
        device.epoch,
        time_ns,
        device.admission.owner,
        used,
        answers,
        device.repeated == session.boot,
        state,
        device.placement if device.placement is not None and device.placement.since_ns else None,
        device.board.standing,
    )


def calibrated(checkpoint: Checkpoint) -> Calibration | None:
    """The checkpoint's calibration if made in the checkpoint's own boot, else None."""
    used = checkpoint.calibration
    return used if used is not None and used.boot == checkpoint.boot else None


class Checkpoints:
    """Latest checkpoint and last command replies of each device, from any estimator; bounded number of devices."""

    def __init__(self, devices: int) -> None:
        self._room = devices
        self._latest: dict[str, Checkpoint] = {}
        self._answers: dict[str, Answers] = {}

    def note(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint unless one of a higher epoch is known; checkpoints of one epoch arrive in order."""
        self.answer(checkpoint.device, checkpoint.answers)
        known = self._latest.get(checkpoint.device)
        if known is not None and checkpoint.epoch < known.epoch:
            # A former owner, unaware of the takeover, may have calibrated the device meanwhile.
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
        """Remember replies given to commands for a device."""
        if given:
            known = self._answers.pop(device, ())
            self._answers[device] = (*(one for one in known if one not in given), *given)[-MAX_ANSWERS:]
            while len(self._answers) > self._room:
                del self._answers[next(iter(self._answers))]

    def answers(self, device: str) -> Answers:
        """The last command replies of a device, oldest first."""
        return self._answers.get(device, ())

    def of(self, device: str) -> Checkpoint | None:
        """Latest checkpoint of a device, or None."""
        return self._latest.get(device)

    def lately_from(self, device: str, now_ns: int) -> str:
        """Bridge of a checkpoint no older than LATELY_NS, else empty: a device silent for longer may be anywhere."""
        known = self._latest.get(device)
        return known.bridge if known is not None and abs(now_ns - known.time_ns) <= LATELY_NS else ""

    def calibration(self, device: str, boot: int) -> Calibration | None:
        """Calibration of exactly this boot from the latest checkpoint, or None."""
        known = self._latest.get(device)
        return None if known is None or known.boot != boot else calibrated(known)

    def repeated(self, device: str, boot: int) -> bool:
        """Whether this boot has a number that another power-up used before, and is not calibrated yet."""
        known = self._latest.get(device)
        return known is not None and known.boot == boot and known.boot_repeated and not calibrated(known)

    def forget(self, device: str) -> None:
        """Drop the checkpoint of a device that this estimator now knows better."""
        self._latest.pop(device, None)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """Latest calibration of an earlier boot of the same hardware, or None."""
        known = self._latest.get(info.device)
        used = None if known is None else known.calibration
        if used is None or used.boot == info.boot or differing(restore_key(used), info):
            return None
        return used
