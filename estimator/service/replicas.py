"""What the estimators of a ward tell each other of their devices, so that any of them can go on with any device. Pure."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bridge.wire.estimators import MAX_ANSWERS
from bridge.wire.messages import Calibration, Checkpoint, CommandReply, DeviceInfo
from estimator.remembered import Remembered
from estimator.restore import differing, restore_key
from estimator.service.device import Device
from estimator.track.bias_filter import OWN, BiasState

_NONE = np.zeros(0)
#: no clock of a device shows as much
_ENDLESS_S = 1e12
#: a checkpoint is said every five seconds of a device that is heard
LATELY_NS = 10_000_000_000


Answers = tuple[tuple[str, CommandReply], ...]


def checkpoint_of(device: Device, time_ns: int, answers: Answers = ()) -> Checkpoint | None:
    """What another would need of a device, and what its last commands were answered; None before it has a boot."""
    session = device.session
    if session.boot is None:
        return None
    state, asked = session.checkpoint(), session.learnt.asked or ("", "")
    used = session.calibration or session.prior
    if session.calibration is None and used is not None and used.boot == session.boot:
        used = None  # of another power-up under this number: who restores it would take it for this one's
    known = state is not None and bool(np.isfinite(state.x).all() and np.isfinite(state.P).all())
    return Checkpoint(
        device=device.name,
        boot=session.boot,
        epoch=device.epoch,
        time_ns=time_ns,
        x=state.x[:OWN] if state is not None and known else _NONE,
        covariance=state.P[:OWN, :OWN] if state is not None and known else _NONE.reshape(0, 0),
        device_time_s=state.time if state is not None and known else 0.0,
        temperature_c=state.temperature_c if state is not None and known else np.nan,
        powered_s=state.powered if state is not None and known and abs(state.powered) < _ENDLESS_S else -np.inf,
        doubted=session.tracker.doubt.stands,
        asked_by=asked[0],
        asked_why=asked[1],
        calibration=used,
        bridge=device.admission.source.owner,
        turned=session.learnt.turned,
        answers=answers,
        lag_k=state.lag_k if state is not None and known else 0.0,
        boot_repeated=device.repeated == session.boot,
    )


def remembered_of(known: Checkpoint, now_ns: int) -> Remembered | None:
    """What a checkpoint tells of its boot; None where that is nothing."""
    calibration = known.calibration if _calibrated(known) else None
    bias = None
    if len(known.x):
        at = known.device_time_s, known.temperature_c, known.powered_s
        bias = BiasState(known.x, known.covariance, *at, lag_k=known.lag_k)
    if calibration is None and bias is None and not known.turned:
        return None
    asked = (known.asked_by, known.asked_why) if known.asked_by else None
    return Remembered(calibration, bias, (now_ns - known.time_ns) / 1e9, known.doubted, asked, known.turned)


def _joined(later: Checkpoint, calibrated: Checkpoint) -> Checkpoint:
    """What is known by a later turn, and by who calibrated it meanwhile.

    A bias that was doubted without that is the calibration's, until a rest tells; where none was known it is the other's.
    """
    both = replace(later, calibration=calibrated.calibration, doubted=False, turned=())
    if later.doubted:
        return replace(both, x=_NONE, covariance=_NONE.reshape(0, 0))
    if len(later.x):
        return both
    return replace(
        both,
        x=calibrated.x,
        covariance=calibrated.covariance,
        device_time_s=calibrated.device_time_s,
        temperature_c=calibrated.temperature_c,
        powered_s=calibrated.powered_s,
        lag_k=calibrated.lag_k,
        doubted=calibrated.doubted,
    )


def _calibrated(checkpoint: Checkpoint) -> bool:
    """Whether it has a calibration of its own boot."""
    return checkpoint.calibration is not None and checkpoint.calibration.boot == checkpoint.boot


class Replicas:
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
            if not of_it or _calibrated(known) or not _calibrated(checkpoint):
                return
            checkpoint = _joined(known, checkpoint)
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

    def recall(self, device: str, boot: int, now_ns: int) -> Remembered | None:
        """What was said of this very boot."""
        known = self._latest.get(device)
        return None if known is None or known.boot != boot else remembered_of(known, now_ns)

    def repeated(self, device: str, boot: int) -> bool:
        """Whether this very boot has a number that another power-up had, and was not calibrated."""
        known = self._latest.get(device)
        return known is not None and known.boot == boot and known.boot_repeated and not _calibrated(known)

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
