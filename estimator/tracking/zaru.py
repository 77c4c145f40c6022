"""Zero angular rate update (ZARU): while the device rests, its gyro reading measures its bias.

With an accelerometer, gravity splits a rest into two parts.

- Horizontal part: a turn about a horizontal axis would tilt gravity, so this part is checked and always usable.
- Vertical part: a turn about the vertical is invisible, and a bed or chair can turn slowly and evenly. This part must
    pass its gate. If it stays outside the gate but constant for two minutes, it is accepted.

The same gyro axis is vertical in one pose and horizontal in another, where its bias is checked.
"""

from collections.abc import Iterable
from math import ceil, inf

import msgspec
import numpy as np

from estimator.kernels.zaru import along, calm, together, upright
from estimator.state import Floats, StateStruct, shaped
from estimator.tracking import zaru_limits as limits
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.gravity import GRAVITY
from estimator.tracking.seconds import Second
from estimator.tracking.tilt_check import TiltCheck

#: number of latest seconds whose means are compared
_RECENT = 8
#: NIS by degrees of freedom that one measurement in a thousand exceeds
_SURPRISE = {1: 10.83, 2: 13.82, 3: 16.27}
_AXES = np.eye(3)
#: a measurement to be judged with the following ones; its begin and end, s, and temperature, °C
_Waiting = tuple[Evidence, float, float, float]
REFUSED_TILT, UNPROVEN = "it tilts", "quiet for a few seconds only"
INSISTED, JUMPED = "insisted", "jumped"


class Zaru(StateStruct):
    """ZARU evidence: takes one-second blocks of rest, updates one BiasFilter, and gives receipts.

    A quiet block has little scatter; a block of rest is also free of breathing and swaying.
    means (k, 2, 3): mean (rad/s) and its variance ((rad/s)²) of the latest quiet blocks, at most eight.
    quiet, rests: number of quiet blocks, and of blocks of rest, in a row.
    quiet_until: end of the last quiet block, device time in s.
    gap_s: length of the latest gap of 5 s or more between quiet blocks, s.
    proven: True if the latest block belongs to a proven rest, which is long enough to exclude a breath.
    rested: True if a rest was proven since a restart.
    ever_proven: True if any rest was proven, or the bias was known at the start.
    blind: True if samples were missing and no rest has been recognised since.
    surprised: kinds of evidence already checked for a large innovation since the latest gap.
    in_question: remaining variance, (rad/s)², of a bias that was accepted only because a contradiction lasted two
        minutes.
    waiting: measurements that will be judged together with the following ones.
    contradiction: start (device time, s), z (rad/s) and R ((rad/s)²) of a contradiction that lasts, or None.
    receipts_before, receipts_late: receipts that `surprises` and `judged` will return next.
    Raises ValueError for a damaged state.
    """

    tilt: TiltCheck = msgspec.field(default_factory=TiltCheck)
    ever_proven: bool = False
    means: Floats = msgspec.field(default_factory=lambda: np.zeros((0, 2, 3)))
    quiet: int = 0
    quiet_until: float = inf
    rests: int = 0
    gap_s: float = 0.0
    proven: bool = False
    rested: bool = True
    blind: bool = False
    surprised: set[str] = msgspec.field(default_factory=lambda: {"zaru", "zaru level", "zaru vertical"})
    in_question: float = 0.0
    waiting: list[_Waiting] = msgspec.field(default_factory=list)
    contradiction: tuple[float, Floats, Floats] | None = None
    receipts_before: list[Receipt] = msgspec.field(default_factory=list)
    receipts_late: list[Receipt] = msgspec.field(default_factory=list)

    def __post_init__(self) -> None:
        shaped(self.means, -1, 2, 3)
        for evidence, *_ in self.waiting:
            m = len(evidence.z)
            if m not in GATES:
                raise ValueError("damaged state: a waiting measurement is malformed; start without this state")
            shaped(evidence.z, m, finite=True)
            shaped(evidence.H, m, -1, finite=True)
            shaped(evidence.R, m, m, finite=True)
            if evidence.common_var is not None:
                shaped(evidence.common_var, m)
        if self.contradiction is not None:
            _, z, R = self.contradiction
            shaped(z, -1)
            shaped(R, len(z), len(z))

    def moved(self, bias: BiasFilter) -> None:
        """End the rest because the device moves.

        Measurements that wait are judged now, and update `bias` if they pass. A contradiction that lasts is dropped.
        """
        self.in_question, self.contradiction, self.blind = 0.0, None, False
        self._over(bias)

    def unseen(self, bias: BiasFilter, seconds: float) -> None:
        """End the rest after `seconds` without usable samples.

        Measurements that wait are judged now, and update `bias` if they pass. The device may still rest, so a
        contradiction is kept, without counting these seconds.
        """
        self._lengthen(seconds)
        self.blind = True
        self._over(bias)

    def interrupted(self, bias: BiasFilter, seconds: float) -> None:
        """Process `seconds` in which the device was quiet but not at rest, for example because the wearer breathes.

        Measurements that wait are judged now, and update `bias` if they pass. A contradiction that lasts is dropped. It
        is kept if samples were missing and no rest has been recognised since.
        """
        if self.blind:  # stillness is recognised only some time after a hole
            self._lengthen(seconds)
        else:
            self.contradiction = None
        self._judge(bias)

    def _lengthen(self, seconds: float) -> None:
        if self.contradiction is not None:
            since, z, R = self.contradiction
            self.contradiction = since + seconds, z, R

    def _over(self, bias: BiasFilter) -> None:
        self.quiet = self.rests = 0
        self.means = self.means[:0]
        self.tilt = TiltCheck()
        self._judge(bias)

    def _judge(self, bias: BiasFilter) -> None:
        """Judge the waiting measurements now, without the ones that would have followed."""
        if self.waiting:
            evidence, begun, ended, celsius = self.waiting.pop()
            self.waiting.append((self._at_edge(evidence), begun, ended, celsius))
        while self.waiting:
            self.receipts_late.append(self._late(bias))

    def judged(self) -> list[Receipt]:
        """Return the receipts of measurements that were judged only when their rest ended, and remove them from the list.

        Each receipt is returned once.
        """
        receipts, self.receipts_late = self.receipts_late, []
        return receipts

    def surprises(self) -> list[Receipt]:
        """Return the receipts of measurements with an improbably large innovation after a gap, and remove them from the list.

        Such an innovation is taken for a bias change in the gap, and the filter's bias covariance is then enlarged.
        Each receipt holds innovation (rad/s), innovation covariance ((rad/s)²) and NIS as computed before this
        enlargement.
        """
        receipts, self.receipts_before = self.receipts_before, []
        return receipts

    def at_rest(self, second: Second) -> bool:
        """Add a quiet one-second block; return True if it belongs to a rest, and not to breathing or swaying.

        The device is at rest if the block was judged still, and if the means of the latest quiet blocks agree within
        their noise.
        """
        self.quiet += 1
        latest = np.array([[second.mean, second.mean_var]])
        self.means = np.concatenate([self.means[1 - _RECENT :], latest])
        quiet = calm(self.means, limits.QUASI_STATIC**2, limits.SCATTER)
        if self.tilt.watch(second):
            self.waiting.clear()
        if second.start - self.quiet_until >= limits.GAP_S:
            self.gap_s, self.surprised = second.start - self.quiet_until, set()
        self.quiet_until = second.end
        resting = second.still and quiet
        self.rests = self.rests + 1 if resting else 0
        self.blind = self.blind and not resting
        return resting

    def take(
        self, second: Second, bias: BiasFilter, up: Floats | None, gravity: Evidence | None = None
    ) -> tuple[list[Receipt], Receipt | None]:
        """Update the filter with a one-second block of rest and, in the same call, with the gravity evidence.

        second: a block for which `at_rest` returned True. bias: the filter.
        up (3,): gravity in sensor axes, of any length; None without an accelerometer.
        gravity: gravity evidence, applied in one joint update with the horizontal part of the rest, or None.
        Returns two results: receipts of the rest, and the receipt of the gravity evidence or None.
        """
        # For a gyro alone a rest may be a slow passage of a movement, until it continues.
        proven = self.proven = self.quiet >= limits.PROVEN_AFTER and (up is not None or self.rests > 1)
        self.ever_proven |= proven
        self.rested |= proven
        checked = up is not None and self.ever_proven
        motion_var = limits.QUASI_STATIC**2 if proven else self._unproven_var(second, checked=checked)
        var, said = second.mean_var + motion_var, None
        if gravity is not None and (self.tilt.seen or self._begins(proven=proven)):
            said, gravity, up = bias.update(gravity), None, bias.x[GRAVITY]
        if up is None or second.accel_mean is None:
            receipts = self._gated(_along("zaru", _AXES, second, var, GATES[3], bias), second, bias)
        elif self.tilt.seen:
            self.waiting.clear()
            z = second.mean - bias.x[BIAS]
            self.contradiction = None
            nothing = Receipt(bias.time, "zaru", z, np.diag(var), np.inf, accepted=False, reason=REFUSED_TILT)
            return [nothing], said
        else:
            axes = upright(up)
            level, vertical = _split(_along("zaru", axes, second, var, GATES[2], bias), limits.VERTICAL_GATE)
            receipt, also = self._level(level, gravity, second, bias)
            said = said or also
            receipts = [receipt, *self._gated(vertical, second, bias)]
        return receipts if proven else [r._replace(reason=r.reason or UNPROVEN) for r in receipts], said

    def _begins(self, *, proven: bool) -> bool:
        """Return whether to use gravity's evidence first: at a rest's start gravity may tell more than within the rest."""
        return self.rests == 1 or (proven and "zaru level" not in self.surprised)

    def _unproven_var(self, second: Second, *, checked: bool) -> Floats | float:
        """(3,) variance of possible motion in an unproven rest; a rate changing within the second adds to it."""
        if not checked:
            return limits.UNPROVEN_AT_MOST**2
        half = second.samples // 2
        change = second.gyro[half:].mean(axis=0) - second.gyro[:half].mean(axis=0)
        return np.asarray(limits.UNPROVEN**2 + change**2 / 4)

    def _level(
        self, evidence: Evidence, gravity: Evidence | None, second: Second, bias: BiasFilter
    ) -> tuple[Receipt, Receipt | None]:
        """Update with the two horizontal parts of a rest, after or together with gravity.

        If the bias there is surprising, it has moved; the vertical part is then doubted by as much.
        """
        self._adapt(evidence, bias)
        said, receipt = (None, bias.update(evidence)) if gravity is None else bias.update_both(gravity, evidence)
        if 1 < receipt.test_ratio < np.inf and self._checked(second, receipt.innovation):
            return self._believed(receipt, evidence, bias, JUMPED), said
        return receipt, said

    def _gated(self, evidence: Evidence, second: Second, bias: BiasFilter) -> list[Receipt]:
        """Update with unchecked parts: they must pass the gate, averaged over seconds if noisy, or insist."""
        self._adapt(evidence, bias)
        if self.waiting and len(self.waiting[0][0].z) != len(evidence.z):
            self.waiting.clear()  # the accelerometer appeared or vanished
        evidence = self._questioned(evidence)
        self.waiting.append((evidence, second.start, second.end, bias.temperature_c))
        weighed = bias.weigh(_mean(evidence, self.waiting) if len(self.waiting) > 1 else evidence)
        if weighed.accepted:
            self.contradiction = None
            ready = len(self.waiting) + 1 - ceil(self._waits(evidence, weighed))
            return [self._late(bias) for _ in range(ready)]
        begun = self.waiting[0][1]
        self.waiting.clear()
        if not self._insisted(weighed.time, begun, evidence.z, evidence.R, bias):
            return [weighed]
        self.contradiction = None
        # The device may still turn: this variance remains until it has moved and rests again.
        self.in_question = float(np.mean(weighed.innovation**2)) / 4
        return [self._believed(weighed, self._questioned(evidence), bias, INSISTED)]

    def _at_edge(self, evidence: Evidence) -> Evidence:
        if evidence.kind != "zaru":
            return evidence  # measured with an accelerometer
        return evidence._replace(R=evidence.R + limits.EDGE**2 * np.eye(len(evidence.R)))

    def _questioned(self, evidence: Evidence) -> Evidence:
        if not self.in_question:
            return evidence
        common = np.zeros(len(evidence.z)) if evidence.common_var is None else evidence.common_var
        return evidence._replace(common_var=np.maximum(common, self.in_question))

    def _late(self, bias: BiasFilter) -> Receipt:
        """Update with the measurement that has waited longest, corrected for the walk since then."""
        evidence, _, end, celsius = self.waiting.pop(0)
        receipt = bias.update_late(evidence, end, celsius)
        unproven = min(evidence.R.diagonal().tolist()) >= limits.UNPROVEN**2
        return receipt._replace(reason=receipt.reason or UNPROVEN) if unproven else receipt

    def _waits(self, evidence: Evidence, weighed: Receipt) -> float:
        """Number of seconds to judge together: 1, so none wait, while the bias is less certain than one second's mean.

        Otherwise at least 2: the latest second always waits, it may be the last of its rest.
        """
        own, seen = evidence.R.diagonal().tolist(), weighed.innovation_cov.diagonal().tolist()
        most, waiting = float(max(own)), len(self.waiting)
        for var, R in zip(seen, own, strict=True):
            if var - R / waiting > most:
                return 1
        return min(limits.LONGEST_WAIT_S, max(2.0, most / limits.CERTAIN**2))

    def _believed(self, refused: Receipt, evidence: Evidence, bias: BiasFilter, reason: str) -> Receipt:
        """Accept a refused measurement: widen the bias by its innovation, then update."""
        bias.widen(float(np.mean(refused.innovation**2)) * np.eye(3))
        bias.update(evidence)
        return refused._replace(accepted=True, reason=reason)

    def _adapt(self, evidence: Evidence, bias: BiasFilter) -> None:
        """Widen all axes when the first rest after a gap is surprising: the bias walked faster than expected, in bounds."""
        if evidence.kind in self.surprised or not self.proven:
            return
        self.surprised.add(evidence.kind)
        weighed = bias.weigh(evidence)
        if _SURPRISE[len(evidence.z)] < weighed.nis < np.inf:
            self.receipts_before.append(weighed)
            most = (limits.HURRY * bias.knobs.rate_random_walk) ** 2 * self.gap_s
            bias.widen(min(float(np.mean(weighed.innovation**2)), most) * np.eye(3))

    def _checked(self, second: Second, innovation: Floats) -> bool:
        """Return whether a turn at the rate of the innovation would have tilted gravity visibly by now."""
        if self.rests < limits.SURE_RESTS:
            return False
        return self.tilt.would_show(float(np.linalg.norm(innovation)), second)

    def _insisted(self, now: float, start: float, z: Floats, R: Floats, bias: BiasFilter) -> bool:
        if self.contradiction is None or not self._same(*self.contradiction, now, z, R, bias):
            self.contradiction = start, z, R
        return now - self.contradiction[0] >= limits.INSIST_S

    def _same(self, since: float, z0: Floats, R0: Floats, now: float, z: Floats, R: Floats, bias: BiasFilter) -> bool:
        if len(z0) != len(z):
            return False
        walk = bias.knobs.rate_random_walk**2 * (now - since) * np.eye(len(z))
        apart = z - z0
        return bool(apart @ np.linalg.solve(R + R0 + walk, apart) <= GATES[len(z)])


def _along(kind: str, axes: Floats, second: Second, var: Floats, gate: float, bias: BiasFilter) -> Evidence:
    """Mean of a second, with variance var (3,), as a measurement of the bias along axes (m, 3)."""
    z, H, R, common_var = along(axes, second.mean, var, second.common_var, len(bias.x))
    return Evidence(kind, z, H, R, gate, common_var)


def _split(whole: Evidence, vertical_gate: float) -> tuple[Evidence, Evidence]:
    """Split a measurement into its two horizontal parts and the vertical one."""
    kind, z, H, R, gate, common_var, _ = whole
    assert common_var is not None
    level = Evidence(f"{kind} level", z[:2], H[:2], R[:2, :2], gate, common_var[:2])
    return level, Evidence(f"{kind} vertical", z[2:], H[2:], R[2:, 2:], vertical_gate, common_var[2:])


def _mean(latest: Evidence, waiting: Iterable[_Waiting]) -> Evidence:
    """Mean of all waiting measurements, the latest included; their common error does not average out."""
    common = np.zeros(len(latest.z)) if latest.common_var is None else latest.common_var
    z, R = together(np.array([e.z for e, *_ in waiting]), np.array([e.R for e, *_ in waiting]), common)
    return latest._replace(z=z, R=R)
