"""Bias monitor: doubts the tracked bias when rests, gravity or lack of evidence speak against it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.innovation_consistency import ConsistencyState, InnovationConsistency
from estimator.tracking.zaru import INSISTED, JUMPED, UNPROVEN

#: parts of the bias, horizontal and vertical: one may be wrong while rests agree with the other
_PARTS = "level", "vertical"


@dataclass(frozen=True, slots=True)
class BiasMonitorKnobs:
    """Thresholds for a doubt of the bias."""

    #: s without an accepted rest
    evidence_age_s: float = 1800.0
    #: seconds of rest in a row that contradict the bias
    contradictions: int = 5
    #: factor of `InnovationConsistency.inflation`
    inflation: float = 3.0


class BiasMonitorState(StateStruct):
    """State of the bias monitor.

    why: reasons of the present doubt, or empty. contradictions: by part of the bias (level, vertical), their number
    since a rest last agreed. refused: by part, error of the latest contradiction, rad/s, and its kind. agreed: parts
    that rests have agreed with since the doubt began. consistency: latest innovations.
    """

    why: Sentences
    contradictions: dict[str, int]
    refused: dict[str, tuple[float, str]]
    agreed: set[str]
    consistency: ConsistencyState


class BiasMonitor:
    """Bias monitor: receipts in; reasons to doubt the bias, or the end of a doubt, out."""

    def __init__(self, knobs: BiasMonitorKnobs | None = None) -> None:
        self.knobs = knobs or BiasMonitorKnobs()
        #: reasons while the bias is doubted, else empty
        self.why: Sentences = ()
        self.last_receipt: Receipt | None = None
        self.consistency = InnovationConsistency()
        self._contradictions, self._refused = dict.fromkeys(_PARTS, 0), dict[str, tuple[float, str]]()
        self._agreed = set[str]()

    @property
    def state(self) -> BiasMonitorState:
        """State to save for `restore`."""
        return BiasMonitorState(self.why, self._contradictions, self._refused, self._agreed, self.consistency.state)

    def restore(self, state: BiasMonitorState) -> None:
        """Restore a state. Raises ValueError when it names unknown parts."""
        if not set(state.contradictions) == set(_PARTS) >= {*state.refused, *state.agreed}:
            raise ValueError("damaged state: parts of a bias that there are not")
        self.why, self._contradictions, self._refused = state.why, state.contradictions, state.refused
        self._agreed = state.agreed
        self.consistency.restore(state.consistency)

    @property
    def stands(self) -> bool:
        """Whether the bias is doubted; independent of the life cycle state, so a recalibration does not hide it."""
        return bool(self.why)

    def anew(self) -> None:
        """Reset the monitor for a new bias: no doubt, and no contradictions or innovations counted."""
        self._contradictions = dict.fromkeys(_PARTS, 0)
        self.why = ()
        self._agreed.clear()
        self.consistency.forget()

    def take(self, receipts: Sequence[Receipt], surprises: Sequence[Receipt], *, rested: bool = True) -> None:
        """Add the receipts of rests, to count contradictions and check consistency.

        surprises: receipts from before the filter widened the bias, used for consistency only.
        rested: whether a rest was proven since a restart. Before that ZARU receipts do not count for consistency: the
        first quiet second may be a breath, and could cause a doubt by itself.
        """
        for receipt in (*surprises, *receipts):
            if rested or not receipt.kind.startswith("zaru"):
                self.consistency.take(receipt)
        for receipt in receipts:
            self.last_receipt = receipt
            if receipt.reason in {INSISTED, JUMPED}:
                self.consistency.forget()  # evidence against the old bias supports the new one
            for part in _parts(receipt.kind):
                self._heard(part, receipt)

    def _heard(self, part: str, receipt: Receipt) -> None:
        """Count agreement or contradiction for one part; unproven rests cannot confirm: they agree with much that is wrong."""
        if not receipt.accepted:
            # One stretch of bounded motion counts as many seconds.
            self._contradictions[part] += self.knobs.contradictions if receipt.kind.startswith("bounded") else 1
            self._refused[part] = float(np.max(np.abs(receipt.innovation))), receipt.kind
            self._agreed.discard(part)
        elif receipt.reason != UNPROVEN:
            self._contradictions[part] = 0
            if receipt.reason != INSISTED:
                self._agreed.add(part)

    def news(self, age_s: float, *, gravity: bool) -> Sentences:
        """Reasons for a new doubt; empty when there is none or the bias is already doubted.

        age_s: seconds since the last accepted rest, or since one was waited for. gravity: whether the accelerometer
        contradicts the bias.
        """
        reason: Sentence | None = None
        against = [self._refused[part] for part in _PARTS if self._contradictions[part] >= self.knobs.contradictions]
        if against:
            off, kind = max(against)
            code = Code.QUIET_CONTRADICTS_BIAS if kind.startswith("bounded") else Code.REST_CONTRADICTS_BIAS
            reason = code(rate_dps=f"{degrees(off):.2f}")
        elif gravity:
            reason = Code.GRAVITY_CONTRADICTS_BIAS()
        elif self.consistency.inflation > self.knobs.inflation:
            reason = Code.RESTS_DISAGREE(times=f"{self.consistency.inflation:.1f}")
        elif age_s > self.knobs.evidence_age_s:
            reason = Code.NO_REST_FOR(minutes=f"{age_s / 60:.0f}")
        if reason is None or self.stands:
            return ()
        self.why = (reason,)
        self._agreed.clear()
        return self.why

    def settled(self, age_s: float, *, sure: bool, gravity: bool) -> bool:
        """End the doubt if rests have confirmed every part, the bias is sure, and nothing speaks against it.

        Returns whether the doubt ended. age_s, gravity: as in `news`. sure: whether the bias' standard deviation is
        small enough.
        """
        against = gravity or self.consistency.inflation > self.knobs.inflation
        against = against or age_s > self.knobs.evidence_age_s  # unproven rests do not end the wait
        if against or not sure or not self._agreed.issuperset(_PARTS):
            return False
        self.why = ()
        return True


def _parts(kind: str) -> list[str]:
    """Parts of the bias that a kind of evidence measures; all unless its name ends with one."""
    return [part for part in _PARTS if kind.endswith(part)] or list(_PARTS)
