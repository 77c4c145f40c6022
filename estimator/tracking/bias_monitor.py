"""Bias monitor: what rests, gravity and time say against the tracked bias."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from bridge.reasons.codes import Code, Sentence, Sentences
from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.innovation_consistency import ConsistencyState, InnovationConsistency
from estimator.tracking.zaru import INSISTED, JUMPED, UNPROVEN

#: parts of the bias, across gravity and along it, of which either may be off while rests agree with the other
_PARTS = "level", "vertical"


@dataclass(frozen=True, slots=True)
class BiasMonitorKnobs:
    """When a bias is doubted."""

    #: without accepted evidence of rest for this long, s
    evidence_age_s: float = 1800.0
    #: after so many seconds of rest in a row that contradict it
    contradictions: int = 5
    #: or when innovations are so many times larger than they may be
    inflation: float = 3.0


class BiasMonitorState(StateStruct):
    """By part: contradictions since a rest last agreed, and how far off the latest was, rad/s, and its kind.

    agreed: parts that rests have agreed with since the bias was doubted.
    """

    why: Sentences
    contradictions: dict[str, int]
    refused: dict[str, tuple[float, str]]
    agreed: set[str]
    consistency: ConsistencyState


class BiasMonitor:
    """Receipts in; a reason to doubt, or to trust again, out."""

    def __init__(self, knobs: BiasMonitorKnobs | None = None) -> None:
        self.knobs = knobs or BiasMonitorKnobs()
        #: the reason as long as the bias is doubted, else none
        self.why: Sentences = ()
        self.last_receipt: Receipt | None = None
        self.consistency = InnovationConsistency()
        self._contradictions, self._refused = dict.fromkeys(_PARTS, 0), dict[str, tuple[float, str]]()
        self._agreed = set[str]()

    @property
    def state(self) -> BiasMonitorState:
        """All that evolves."""
        return BiasMonitorState(self.why, self._contradictions, self._refused, self._agreed, self.consistency.state)

    def restore(self, state: BiasMonitorState) -> None:
        """Go on from a state. Raises ValueError."""
        if not set(state.contradictions) == set(_PARTS) >= {*state.refused, *state.agreed}:
            raise ValueError("damaged state: parts of a bias that there are not")
        self.why, self._contradictions, self._refused = state.why, state.contradictions, state.refused
        self._agreed = state.agreed
        self.consistency.restore(state.consistency)

    @property
    def stands(self) -> bool:
        """Whether it is doubted; beside the state of life: a device that is being recalibrated is no better than before."""
        return bool(self.why)

    def anew(self) -> None:
        """Nothing speaks against what is believed from now on."""
        self._contradictions = dict.fromkeys(_PARTS, 0)
        self.why = ()
        self._agreed.clear()
        self.consistency.forget()

    def take(self, receipts: Sequence[Receipt], surprises: Sequence[Receipt], *, rested: bool = True) -> None:
        """Note receipts of rests; surprises: what the filter was told to expect before it took any of them.

        rested: whether there was a rest that is one since a restart: the first quiet second after it may well be a breath, and
        would be enough by itself to doubt everything.
        """
        for receipt in (*surprises, *receipts):
            if rested or not receipt.kind.startswith("zaru"):
                self.consistency.take(receipt)
        for receipt in receipts:
            self.last_receipt = receipt
            if receipt.reason in {INSISTED, JUMPED}:
                self.consistency.forget()  # what was against the old bias speaks for the new
            for part in _parts(receipt.kind):
                self._heard(part, receipt)

    def _heard(self, part: str, receipt: Receipt) -> None:
        """What a rest said of a part; a few quiet seconds would agree with much that is wrong."""
        if not receipt.accepted:
            # A stretch is as good as many seconds.
            self._contradictions[part] += self.knobs.contradictions if receipt.kind.startswith("bounded") else 1
            self._refused[part] = float(np.max(np.abs(receipt.innovation))), receipt.kind
            self._agreed.discard(part)
        elif receipt.reason != UNPROVEN:
            self._contradictions[part] = 0
            if receipt.reason != INSISTED:
                self._agreed.add(part)

    def news(self, age_s: float, *, gravity: bool) -> Sentences:
        """Why it is doubted from now on; none when that is no news, or there is no reason.

        age_s: since the last evidence of rest, or since one was waited for. gravity: whether the accelerometer is against it.
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
        """Whether rests have made all of a bias certain again that is sure in itself, and would not be doubted at once."""
        against = gravity or self.consistency.inflation > self.knobs.inflation
        against = against or age_s > self.knobs.evidence_age_s  # a rest that proved none does not end the wait for one
        if against or not sure or not self._agreed.issuperset(_PARTS):
            return False
        self.why = ()
        return True


def _parts(kind: str) -> list[str]:
    """Those that a kind of evidence tells of: all, where it is of no one."""
    return [part for part in _PARTS if kind.endswith(part)] or list(_PARTS)
