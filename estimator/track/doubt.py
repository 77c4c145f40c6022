"""Whether a bias is to be doubted: what rests, gravity and time say against it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from estimator.track.consistency import Consistency
from estimator.track.evidence import Receipt
from estimator.track.zaru import INSISTED, JUMPED


@dataclass(frozen=True, slots=True)
class DoubtKnobs:
    """When a bias is doubted."""

    #: without accepted evidence of rest for this long, s
    evidence_age_s: float = 1800.0
    #: after so many seconds of rest in a row that contradict it
    contradictions: int = 5
    #: or when innovations are so many times larger than they may be
    inflation: float = 3.0


class Doubt:
    """Receipts in; a reason to doubt, or to trust again, out."""

    def __init__(self, knobs: DoubtKnobs | None = None) -> None:
        self.knobs = knobs or DoubtKnobs()
        #: the reason, in words, as long as it is doubted, else none
        self.why = ""
        self.last_receipt: Receipt | None = None
        self.consistency = Consistency()
        self._contradictions = 0

    @property
    def stands(self) -> bool:
        """Whether it is doubted; beside the state of life: a device that is being recalibrated is no better than before."""
        return bool(self.why)

    def anew(self) -> None:
        """Nothing speaks against what is believed from now on."""
        self._contradictions, self.why = 0, ""
        self.consistency.forget()

    def interrupted(self) -> None:
        """What follows is not seen: rests in a row end here."""
        self._contradictions = 0

    def take(self, receipts: Sequence[Receipt], surprises: Sequence[Receipt]) -> None:
        """Note receipts of rests; surprises: what the filter was told to expect before it took any of them."""
        for receipt in (*surprises, *receipts):
            self.consistency.take(receipt)
        for receipt in receipts:
            self.last_receipt = receipt
            if receipt.reason in {INSISTED, JUMPED}:
                self.consistency.forget()  # what was against the old bias speaks for the new
            if not receipt.accepted:
                # A stretch is as good as many seconds.
                self._contradictions += self.knobs.contradictions if receipt.kind.startswith("bounded") else 1
        if receipts and all(r.accepted for r in receipts):
            self._contradictions = 0

    def news(self, age_s: float, *, gravity: bool) -> str | None:
        """Why it is doubted from now on, in words; None when that is no news, or there is no reason.

        age_s: since the last evidence of rest, or since one was waited for. gravity: whether the accelerometer is against it.
        """
        reason = None
        if self.last_receipt is not None and self._contradictions >= self.knobs.contradictions:
            by = degrees(float(np.max(np.abs(self.last_receipt.innovation))))
            reason = f"at rest it reads {by:.2f} °/s off: turning slowly, or the bias jumped"
        elif gravity:
            reason = "gravity disagrees: the bias jumped, or the accelerometer is wrong"
        elif self.consistency.inflation > self.knobs.inflation:
            reason = f"rests disagree with each other by {self.consistency.inflation:.1f} times what they may"
        elif age_s > self.knobs.evidence_age_s:
            reason = f"no rest for {age_s / 60:.0f} minutes"
        if reason is None or self.stands:
            return None
        self.why = reason
        return reason

    def settled(self, age_s: float, *, sure: bool, gravity: bool) -> bool:
        """Whether the last rest has made a bias certain again that is sure in itself, and would not be doubted at once."""
        receipt = self.last_receipt
        against = self._contradictions or gravity or self.consistency.inflation > self.knobs.inflation
        against = against or age_s > self.knobs.evidence_age_s  # a rest that proved none does not end the wait for one
        if against or not sure or receipt is None or not receipt.accepted or receipt.reason == INSISTED:
            return False
        self.why = ""
        return True
