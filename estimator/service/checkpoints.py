"""Checkpoints (saved sessions) of devices from all estimators, so that any estimator can continue a session. Pure."""

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
    """Build the checkpoint of a device, from which another estimator can continue its session.

    None before the device's first boot.
    time_ns: host time, ns since the Unix epoch. answers: the latest command replies of the device, each with its verb.
    """
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
        device.placement,
        device.board.standing,
    )


def calibrated(checkpoint: Checkpoint) -> Calibration | None:
    """Return the calibration of a checkpoint if it was made in the checkpoint's boot, else None."""
    used = checkpoint.calibration
    return used if used is not None and used.boot == checkpoint.boot else None


class Checkpoints:
    """Latest checkpoint and latest command replies of each device, from any estimator.

    devices: largest number of devices kept; beyond it, the device whose checkpoint arrived longest ago is dropped.
    """

    def __init__(self, devices: int) -> None:
        self._room = devices
        self._latest: dict[str, Checkpoint] = {}
        self._answers: dict[str, Answers] = {}

    def note(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint, unless the one already kept has a higher epoch.

        The epoch is the ownership number, which rises with each takeover. Checkpoints of one epoch arrive in order.
        The calibration of a lower-epoch checkpoint is still used if the kept checkpoint of the same boot has none.
        """
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
        """Remember command replies of a device, as pairs of verb and reply; only the latest MAX_ANSWERS are kept."""
        if given:
            known = self._answers.pop(device, ())
            self._answers[device] = (*(one for one in known if one not in given), *given)[-MAX_ANSWERS:]
            while len(self._answers) > self._room:
                del self._answers[next(iter(self._answers))]

    def answers(self, device: str) -> Answers:
        """Return the latest command replies of a device, as pairs of verb and reply, oldest first.

        Empty if there are none.
        """
        return self._answers.get(device, ())

    def of(self, device: str) -> Checkpoint | None:
        """Return the latest known checkpoint of a device from any estimator, or None."""
        return self._latest.get(device)

    def lately_from(self, device: str, now_ns: int) -> str:
        """Return the bridge named in a device's latest checkpoint, or an empty string if the checkpoint is too old.

        Too old is a checkpoint made more than LATELY_NS before `now_ns` (host time, ns since the Unix epoch). By then
        the device may be on another bridge. Empty also without a checkpoint.
        """
        known = self._latest.get(device)
        return known.bridge if known is not None and abs(now_ns - known.time_ns) <= LATELY_NS else ""

    def forget(self, device: str) -> None:
        """Drop the checkpoint of a device; does nothing if there is none."""
        self._latest.pop(device, None)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """Return the calibration of an earlier boot of the same hardware from the device's latest checkpoint, or None.

        The restore key must match `info`: device, model, firmware, range; for a device without a clock also the rate.
        """
        known = self._latest.get(info.device)
        used = None if known is None else known.calibration
        if used is None or used.boot == info.boot or differing(restore_key(used), info):
            return None
        return used
