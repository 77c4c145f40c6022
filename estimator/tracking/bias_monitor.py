"""Bias monitor: raises a doubt about the tracked bias when rests or gravity contradict it, or when evidence is missing."""

from collections.abc import Sequence
from math import degrees

import msgspec
import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.innovation_consistency import InnovationConsistency
from estimator.tracking.zaru import INSISTED, JUMPED, UNPROVEN

#: parts of the bias, horizontal and vertical: one may be wrong while rests agree with the other
_PARTS = "level", "vertical"
#: s without an accepted rest after which the bias is doubted
EVIDENCE_AGE_S = 1800.0
#: seconds of rest in a row that contradict a bias that is doubted
CONTRADICTIONS = 5
#: factor of `InnovationConsistency.inflation` beyond which the bias is doubted
_INFLATION = 3.0


class BiasMonitor(StateStruct):
    """Bias monitor: takes receipts of rests, and gives reasons to doubt the bias or ends a doubt.

    The bias has two parts: horizontal (`level`) and along the vertical (`vertical`).
    why: reasons of the present doubt, or empty.
    contradictions: for each part, number of contradictions since a rest last agreed.
    refused: for each part, the latest contradiction: largest element of its innovation, rad/s, and its kind of
        evidence.
    agreed: parts that rests have agreed with since the doubt began.
    consistency: check of the latest innovations.
    Raises ValueError for unknown parts.
    """

    why: Sentences = ()
    contradictions: dict[str, int] = msgspec.field(default_factory=lambda: dict.fromkeys(_PARTS, 0))
    refused: dict[str, tuple[float, str]] = msgspec.field(default_factory=dict)
    agreed: set[str] = msgspec.field(default_factory=set)
    consistency: InnovationConsistency = msgspec.field(default_factory=InnovationConsistency)

    def __post_init__(self) -> None:
        if not set(self.contradictions) == set(_PARTS) >= {*self.refused, *self.agreed}:
            raise ValueError("damaged state: a part of the bias has an unknown name; start without this state")

    @property
    def stands(self) -> bool:
        """True if the bias is doubted at present."""
        return bool(self.why)

    def anew(self) -> None:
        """Reset the monitor for a new bias: no doubt, and no contradictions or innovations counted."""
        self.contradictions = dict.fromkeys(_PARTS, 0)
        self.why = ()
        self.agreed.clear()
        self.consistency = InnovationConsistency()

    def take(self, receipts: Sequence[Receipt], surprises: Sequence[Receipt], *, rested: bool = True) -> None:
        """Add the receipts of rests: count contradictions, and check the consistency of innovations.

        surprises: additional receipts for the consistency check only, from `Zaru.surprises`. Each was computed before
            the filter's covariance was enlarged because of a large innovation.
        rested: True if a rest was proven since the restart. Before that, ZARU receipts do not count for consistency,
            because the first quiet second may contain a breath.
        """
        for receipt in (*surprises, *receipts):
            if rested or not receipt.kind.startswith("zaru"):
                self.consistency.take(receipt)
        for receipt in receipts:
            if receipt.reason in {INSISTED, JUMPED}:
                self.consistency = InnovationConsistency()  # evidence against the old bias supports the new one
            for part in _parts(receipt.kind):
                self._heard(part, receipt)

    def _heard(self, part: str, receipt: Receipt) -> None:
        """Count agreement or contradiction for one part; unproven rests cannot confirm: they agree with much that is wrong."""
        if not receipt.accepted:
            # One stretch of bounded motion counts as many seconds.
            self.contradictions[part] += CONTRADICTIONS if receipt.kind.startswith("bounded") else 1
            self.refused[part] = float(np.max(np.abs(receipt.innovation))), receipt.kind
            self.agreed.discard(part)
        elif receipt.reason != UNPROVEN:
            self.contradictions[part] = 0
            if receipt.reason != INSISTED:
                self.agreed.add(part)

    def news(self, age_s: float, *, gravity: bool) -> Sentences:
        """Reasons for a new doubt about the bias; empty when there is none, or when the bias is already doubted.

        age_s: seconds since the last accepted rest, or since tracking began to wait for one.
        gravity: True if the accelerometer contradicts the bias.
        """
        reason: Sentence | None = None
        against = [self.refused[part] for part in _PARTS if self.contradictions[part] >= CONTRADICTIONS]
        if against:
            off, kind = max(against)
            code = Code.QUIET_CONTRADICTS_BIAS if kind.startswith("bounded") else Code.REST_CONTRADICTS_BIAS
            reason = code(rate_dps=f"{degrees(off):.2f}")
        elif gravity:
            reason = Code.GRAVITY_CONTRADICTS_BIAS()
        elif self.consistency.inflation > _INFLATION:
            reason = Code.RESTS_DISAGREE(times=f"{self.consistency.inflation:.1f}")
        elif age_s > EVIDENCE_AGE_S:
            reason = Code.NO_REST_FOR(minutes=f"{age_s / 60:.0f}")
        if reason is None or self.stands:
            return ()
        self.why = (reason,)
        self.agreed.clear()
        return self.why

    def settled(self, age_s: float, *, sure: bool, gravity: bool) -> bool:
        """End the doubt if rests have confirmed every part of the bias and nothing contradicts it; return True if it ended.

        age_s, gravity: as in `news`.
        sure: True if the standard deviation of the bias is small enough, which is also required.
        """
        against = gravity or self.consistency.inflation > _INFLATION
        against = against or age_s > EVIDENCE_AGE_S  # unproven rests do not end the wait
        if against or not sure or not self.agreed.issuperset(_PARTS):
            return False
        self.why = ()
        return True


def _parts(kind: str) -> list[str]:
    """Parts of the bias that a kind of evidence measures; all unless its name ends with one."""
    return [part for part in _PARTS if kind.endswith(part)] or list(_PARTS)
