"""Consistency of the filter: its innovations should be as large as it says, and white."""

from functools import cache
from math import isfinite, sqrt
from operator import mul

import msgspec

from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt

#: receipts that are looked at together
WINDOW = 40
#: chance of a false alarm
_ALARM = 1e-3
#: the same for a correlation of n innovations, times root n
_CHANCE = 3.1
#: a single outlier counts no more than this, per degree of freedom
_CAP = 25.0
_FREEDOMS = range(1, 4)


class ConsistencyState(StateStruct):
    """Of the latest receipts NIS, degrees of freedom, and the mean of the normalised innovations."""

    nis: list[float] = msgspec.field(default_factory=list)
    freedoms: list[int] = msgspec.field(default_factory=list)
    signs: list[float] = msgspec.field(default_factory=list)


class InnovationConsistency:
    """Receipts in; by how much standard deviations are to be enlarged out."""

    def __init__(self) -> None:
        self.restore(ConsistencyState())

    def restore(self, state: ConsistencyState) -> None:
        """Go on from a state."""
        together = len(state.nis) == len(state.freedoms) == len(state.signs) <= WINDOW
        if not together or not all(freedom in _FREEDOMS for freedom in state.freedoms):
            raise ValueError("damaged state: receipts do not go together")
        self.state = state
        #: None when there is news
        self._inflation: float | None = None if state.nis else 1.0
        self._mean = float("nan")

    def take(self, receipt: Receipt) -> None:
        """Note a receipt of a rest."""
        n, state = len(receipt.innovation), self.state
        if isfinite(receipt.nis):
            self._inflation = None
            total = 0.0
            for off, var in zip(receipt.innovation.tolist(), receipt.innovation_cov.diagonal().tolist(), strict=True):
                total += off / sqrt(var)
            state.nis.append(min(receipt.nis, _CAP * n))
            state.freedoms.append(n)
            state.signs.append(total / n)
            del state.nis[:-WINDOW], state.freedoms[:-WINDOW], state.signs[:-WINDOW]

    def forget(self) -> None:
        """Begin anew: what was noted has been explained."""
        self.restore(ConsistencyState())

    @property
    def nis(self) -> float:
        """Mean NIS per degree of freedom; 1 when all is well, NaN before there is any."""
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._mean

    @property
    def whiteness(self) -> float:
        """Correlation of neighbouring innovations, -1 to 1; about 0 when all is well, NaN before there are ten."""
        if len(self.state.signs) < 10:
            return float("nan")
        signs = self.state.signs
        alike, all_of_it = sum(map(mul, signs[1:], signs)), sum(map(mul, signs, signs))
        return alike / all_of_it if all_of_it > 0.0 else 0.0

    @property
    def inflation(self) -> float:
        """What standard deviations are to be multiplied with: 1, or more when innovations are too large or cling together."""
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._inflation

    def _inflated(self) -> float:
        freedom = sum(self.state.freedoms)
        self._mean = nis = sum(self.state.nis) / freedom
        # Smaller than they may be: where noise is put too high, as of quiet seconds that may be no rest, the filter is surer than
        # it says, however much of what is left of them clings together.
        large = nis if nis > _most(freedom) else min(1.0, nis)
        alike = self.whiteness
        # Neighbours that agree by more than chance: so many fewer of them are news.
        clinging = (1 + alike) / (1 - min(alike, 0.9)) if alike > _CHANCE / sqrt(len(self.state.signs)) else 1.0
        return sqrt(max(1.0, large * clinging))


@cache
def _most(freedom: int) -> float:
    """What chi² per degree of freedom is above by chance only."""
    from scipy.stats import chi2  # noqa: PLC0415 - filterpy has loaded it by then

    return float(chi2.isf(_ALARM, freedom)) / freedom
