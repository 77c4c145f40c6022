"""Zero angular rate update (ZARU): while the device rests, its reading is its bias.

With an accelerometer the rest is split by gravity. A turn about a horizontal axis would tilt gravity: the horizontal part of
a rest is checked and always usable. A turn about the vertical is invisible, and a bed or chair turns slowly and evenly: the
vertical part must lie inside its gate. When it stays outside but constant for long, it is believed. In another pose the same
axis becomes horizontal.
"""

from collections.abc import Iterable
from math import ceil

import numpy as np
from numpy.typing import NDArray

from estimator.kernels.zaru import along, calm, together, upright
from estimator.state import shaped
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS
from estimator.tracking.evidence import GATES, Evidence, Receipt
from estimator.tracking.gravity import GRAVITY
from estimator.tracking.seconds import Second
from estimator.tracking.tilt_check import TiltCheck
from estimator.tracking.zaru_state import ZaruKnobs, ZaruState

Floats = NDArray[np.float64]

#: number of latest seconds whose means are compared
_RECENT = 8
#: NIS by degrees of freedom that one measurement in a thousand exceeds
_SURPRISE = {1: 10.83, 2: 13.82, 3: 16.27}
_AXES = np.eye(3)
#: a measurement to be judged with the following ones; its begin and end, s, and temperature, °C
_Waiting = tuple[Evidence, float, float, float]
REFUSED_TILT, UNPROVEN = "it tilts", "quiet for a few seconds only"
INSISTED, JUMPED = "insisted", "jumped"


class Zaru:
    """ZARU evidence: seconds of rest in, receipts out; updates one BiasFilter."""

    def __init__(self, knobs: ZaruKnobs | None = None, *, known: bool = False) -> None:
        """known: whether the bias is known well enough to check a rest against it."""
        self.knobs = knobs or ZaruKnobs()
        self.tilt = TiltCheck(self.knobs.tilt)
        self.state = ZaruState(self.tilt.state, ever_proven=known)

    def saved(self) -> ZaruState:
        """State to save for `restore`."""
        self.state.tilt = self.tilt.state
        return self.state

    def restore(self, state: ZaruState) -> None:
        """Restore a saved state. Raises ValueError when it is damaged."""
        shaped(state.means, -1, 2, 3)
        for evidence, *_ in state.waiting:
            m = len(evidence.z)
            if m not in GATES:
                raise ValueError("damaged state: what waits is no measurement")
            shaped(evidence.z, m, finite=True)
            shaped(evidence.H, m, -1, finite=True)
            shaped(evidence.R, m, m, finite=True)
            if evidence.common_var is not None:
                shaped(evidence.common_var, m)
        if state.contradiction is not None:
            _, z, R = state.contradiction
            shaped(z, -1)
            shaped(R, len(z), len(z))
        self.state, self.tilt.state = state, state.tilt

    def moved(self, bias: BiasFilter) -> None:
        """End the rest because the device moves: measurements that wait are judged now, open questions are dropped."""
        self.state.in_question, self.state.contradiction, self.state.blind = 0.0, None, False
        self._over(bias)

    def unseen(self, bias: BiasFilter, seconds: float) -> None:
        """End the rest after `seconds` without usable samples: measurements that wait are judged now.

        The device may still rest, so questions and contradictions stay open.
        """
        self._lengthen(seconds)
        self.state.blind = True
        self._over(bias)

    def interrupted(self, bias: BiasFilter, seconds: float) -> None:
        """Note `seconds` in which the device was quiet but not at rest; measurements that wait are judged now."""
        if self.state.blind:  # stillness is recognised only some time after a hole
            self._lengthen(seconds)
        else:
            self.state.contradiction = None
        self._judge(bias)

    def _lengthen(self, seconds: float) -> None:
        if self.state.contradiction is not None:
            since, z, R = self.state.contradiction
            self.state.contradiction = since + seconds, z, R

    def _over(self, bias: BiasFilter) -> None:
        self.state.quiet = self.state.rests = 0
        self.state.means = self.state.means[:0]
        self.tilt.over()
        self._judge(bias)

    def _judge(self, bias: BiasFilter) -> None:
        """Judge the waiting measurements now, without the ones that would have followed."""
        if self.state.waiting:
            evidence, begun, ended, celsius = self.state.waiting.pop()
            self.state.waiting.append((self._at_edge(evidence), begun, ended, celsius))
        while self.state.waiting:
            self.state.judged.append(self._late(bias))

    def judged(self) -> list[Receipt]:
        """Fetch the receipts of measurements that waited when their rest ended, once each."""
        judged, self.state.judged = self.state.judged, []
        return judged

    def surprises(self) -> list[Receipt]:
        """Fetch, once each, the receipts of surprising measurements from before the bias was widened for them."""
        surprises, self.state.surprises = self.state.surprises, []
        return surprises

    def at_rest(self, second: Second) -> bool:
        """Note a quiet second; returns whether it belongs to a rest, rather than breathing or swaying."""
        knobs = self.knobs
        self.state.quiet += 1
        latest = np.array([[second.mean, second.mean_var]])
        self.state.means = np.concatenate([self.state.means[1 - _RECENT :], latest])
        quiet = calm(self.state.means, knobs.quasi_static**2, knobs.scatter)
        if self.tilt.watch(second):
            self.state.waiting.clear()
        if second.start - self.state.quiet_until >= knobs.gap_s:
            self.state.gap_s, self.state.surprised = second.start - self.state.quiet_until, set()
        self.state.quiet_until = second.end
        resting = second.still and quiet
        self.state.rests = self.state.rests + 1 if resting else 0
        self.state.blind = self.state.blind and not resting
        return resting

    def take(
        self, second: Second, bias: BiasFilter, up: Floats | None, gravity: Evidence | None = None
    ) -> tuple[list[Receipt], Receipt | None]:
        """Update the filter with a second of rest and, within the rest, with gravity's evidence.

        up (3,): direction of gravity's reading, None without an accelerometer. gravity: its evidence, to be taken in one step
        with the horizontal parts of the rest. Returns receipts of the rest, and gravity's receipt if it was given.
        """
        # For a gyro alone a rest may be a slow passage of a movement, until it continues.
        proven = self.state.proven = self.state.quiet >= self.knobs.proven_after and (
            up is not None or self.state.rests > 1
        )
        self.state.ever_proven |= proven
        self.state.rested |= proven
        checked = up is not None and self.state.ever_proven
        motion_var = self.knobs.quasi_static**2 if proven else self._unproven_var(second, checked=checked)
        var, said = second.mean_var + motion_var, None
        if gravity is not None and (self.tilt.state.seen or self._begins(proven=proven)):
            said, gravity, up = bias.update(gravity), None, bias.x[GRAVITY]
        if up is None or second.accel_mean is None:
            receipts = self._gated(_along("zaru", _AXES, second, var, GATES[3], bias), second, bias)
        elif self.tilt.state.seen:
            self.state.waiting.clear()
            z = second.mean - bias.x[BIAS]
            self.state.contradiction = None
            nothing = Receipt(bias.time, "zaru", z, np.diag(var), np.inf, accepted=False, reason=REFUSED_TILT)
            return [nothing], said
        else:
            axes = upright(up)
            level, vertical = _split(_along("zaru", axes, second, var, GATES[2], bias), self.knobs.vertical_gate)
            receipt, also = self._level(level, gravity, second, bias)
            said = said or also
            receipts = [receipt, *self._gated(vertical, second, bias)]
        return receipts if proven else [r._replace(reason=r.reason or UNPROVEN) for r in receipts], said

    def _begins(self, *, proven: bool) -> bool:
        """Whether gravity's evidence is to be taken first: at the begin of a rest it may tell more than within it."""
        return self.state.rests == 1 or (proven and "zaru level" not in self.state.surprised)

    def _unproven_var(self, second: Second, *, checked: bool) -> Floats | float:
        """(3,) variance of possible motion in an unproven rest; a rate changing within the second adds to it."""
        if not checked:
            return self.knobs.unproven_at_most**2
        half = second.samples // 2
        change = second.gyro[half:].mean(axis=0) - second.gyro[:half].mean(axis=0)
        return np.asarray(self.knobs.unproven**2 + change**2 / 4)

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
        if self.state.waiting and len(self.state.waiting[0][0].z) != len(evidence.z):
            self.state.waiting.clear()  # the accelerometer appeared or vanished
        evidence = self._questioned(evidence)
        self.state.waiting.append((evidence, second.start, second.end, bias.temperature_c))
        weighed = bias.weigh(_mean(evidence, self.state.waiting) if len(self.state.waiting) > 1 else evidence)
        if weighed.accepted:
            self.state.contradiction = None
            ready = len(self.state.waiting) + 1 - ceil(self._waits(evidence, weighed))
            return [self._late(bias) for _ in range(ready)]
        begun = self.state.waiting[0][1]
        self.state.waiting.clear()
        if not self._insisted(weighed.time, begun, evidence.z, evidence.R, bias):
            return [weighed]
        self.state.contradiction = None
        # The device may still turn: this variance remains until it has moved and rests again.
        self.state.in_question = float(np.mean(weighed.innovation**2)) / 4
        return [self._believed(weighed, self._questioned(evidence), bias, INSISTED)]

    def _at_edge(self, evidence: Evidence) -> Evidence:
        if evidence.kind != "zaru":
            return evidence  # measured with an accelerometer
        return evidence._replace(R=evidence.R + self.knobs.edge**2 * np.eye(len(evidence.R)))

    def _questioned(self, evidence: Evidence) -> Evidence:
        if not self.state.in_question:
            return evidence
        common = np.zeros(len(evidence.z)) if evidence.common_var is None else evidence.common_var
        return evidence._replace(common_var=np.maximum(common, self.state.in_question))

    def _late(self, bias: BiasFilter) -> Receipt:
        """Update with the measurement that has waited longest, corrected for the walk since then."""
        evidence, _, end, celsius = self.state.waiting.pop(0)
        receipt = bias.update_late(evidence, end, celsius)
        unproven = min(evidence.R.diagonal().tolist()) >= self.knobs.unproven**2
        return receipt._replace(reason=receipt.reason or UNPROVEN) if unproven else receipt

    def _waits(self, evidence: Evidence, weighed: Receipt) -> float:
        """Number of seconds to judge together: 1, so none wait, while the bias is less certain than one second's mean.

        Otherwise at least 2: the latest second always waits, it may be the last of its rest.
        """
        own, seen = evidence.R.diagonal().tolist(), weighed.innovation_cov.diagonal().tolist()
        most, waiting = float(max(own)), len(self.state.waiting)
        for var, R in zip(seen, own, strict=True):
            if var - R / waiting > most:
                return 1
        return min(self.knobs.longest_wait_s, max(2.0, most / self.knobs.certain**2))

    def _believed(self, refused: Receipt, evidence: Evidence, bias: BiasFilter, reason: str) -> Receipt:
        """Accept a refused measurement: widen the bias by its innovation, then update."""
        bias.widen(float(np.mean(refused.innovation**2)) * np.eye(3))
        bias.update(evidence)
        return refused._replace(accepted=True, reason=reason)

    def _adapt(self, evidence: Evidence, bias: BiasFilter) -> None:
        """Widen all axes when the first rest after a gap is surprising: the bias walked faster than expected, in bounds."""
        if evidence.kind in self.state.surprised or not self.state.proven:
            return
        self.state.surprised.add(evidence.kind)
        weighed = bias.weigh(evidence)
        if _SURPRISE[len(evidence.z)] < weighed.nis < np.inf:
            self.state.surprises.append(weighed)
            most = (self.knobs.hurry * bias.knobs.rate_random_walk) ** 2 * self.state.gap_s
            bias.widen(min(float(np.mean(weighed.innovation**2)), most) * np.eye(3))

    def _checked(self, second: Second, innovation: Floats) -> bool:
        """Whether a turn at the rate of the innovation would have tilted gravity visibly by now."""
        if self.state.rests < self.knobs.sure_rests:
            return False
        return self.tilt.would_show(float(np.linalg.norm(innovation)), second)

    def _insisted(self, now: float, start: float, z: Floats, R: Floats, bias: BiasFilter) -> bool:
        if self.state.contradiction is None or not self._same(*self.state.contradiction, now, z, R, bias):
            self.state.contradiction = start, z, R
        return now - self.state.contradiction[0] >= self.knobs.insist_s

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
