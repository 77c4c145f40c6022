"""Innovation consistency: checks that the filter's innovations have the claimed covariance and are white.

The result is a factor, at least 1, that enlarges standard deviations.
"""

from functools import cache
from math import isfinite, sqrt
from operator import mul

import msgspec

from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt

#: number of latest receipts examined together
WINDOW = 40
#: false alarm probability
_ALARM = 1e-3
#: the same as a limit for the correlation of n innovations, times root n
_CHANCE = 3.1
#: limit of one receipt's NIS, per degree of freedom
_CAP = 25.0
_FREEDOMS = range(1, 4)


class InnovationConsistency(StateStruct, dict=True):
    """Consistency check of innovations: takes receipts, and gives the factor that enlarges standard deviations.

    The latest receipts, at most 40, are kept in three lists:
    nis: NIS of each receipt. freedoms: its degrees of freedom. signs: mean of its innovations, each over its standard
        deviation.
    Raises ValueError when the lists do not match.
    """

    nis: list[float] = msgspec.field(default_factory=list)
    freedoms: list[int] = msgspec.field(default_factory=list)
    signs: list[float] = msgspec.field(default_factory=list)

    def __post_init__(self) -> None:
        together = len(self.nis) == len(self.freedoms) == len(self.signs) <= WINDOW
        if not together or not all(freedom in _FREEDOMS for freedom in self.freedoms):
            raise ValueError("damaged state: the lists of receipts differ in length; start without this state")
        #: cached factor; None when a receipt has come since
        self._inflation: float | None = None if self.nis else 1.0
        self._mean = float("nan")

    def take(self, receipt: Receipt) -> None:
        """Add the receipt of a measurement at rest; a receipt whose NIS is not finite is ignored."""
        n = len(receipt.innovation)
        if isfinite(receipt.nis):
            self._inflation = None
            total = 0.0
            for off, var in zip(receipt.innovation.tolist(), receipt.innovation_cov.diagonal().tolist(), strict=True):
                total += off / sqrt(var)
            self.nis.append(min(receipt.nis, _CAP * n))
            self.freedoms.append(n)
            self.signs.append(total / n)
            del self.nis[:-WINDOW], self.freedoms[:-WINDOW], self.signs[:-WINDOW]

    @property
    def mean_nis(self) -> float:
        """Mean NIS per degree of freedom, no unit: 1 for a consistent filter, NaN without receipts."""
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._mean

    @property
    def whiteness(self) -> float:
        """Lag-one correlation of the innovations, -1 to 1: about 0 for a consistent filter, NaN before ten receipts."""
        if len(self.signs) < 10:
            return float("nan")
        signs = self.signs
        alike, all_of_it = sum(map(mul, signs[1:], signs)), sum(map(mul, signs, signs))
        return alike / all_of_it if all_of_it > 0.0 else 0.0

    @property
    def inflation(self) -> float:
        """Factor for standard deviations: above 1 when innovations are too large or correlated beyond chance, else 1.

        The probability of a false alarm is 0.001.
        """
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._inflation

    def _inflated(self) -> float:
        freedom = sum(self.freedoms)
        self._mean = nis = sum(self.nis) / freedom
        # An NIS below 1 counts: where noise is set too high, as for quiet seconds that may be no rest, the filter is better
        # than it claims, however correlated the remaining innovations are.
        large = nis if nis > _most(freedom) else min(1.0, nis)
        alike = self.whiteness
        # Correlation beyond chance: correlated innovations carry less information.
        clinging = (1 + alike) / (1 - min(alike, 0.9)) if alike > _CHANCE / sqrt(len(self.signs)) else 1.0
        return sqrt(max(1.0, large * clinging))


@cache
def _most(freedom: int) -> float:
    """Limit of chi² per degree of freedom, exceeded by chance with probability _ALARM."""
    from scipy.stats import chi2  # noqa: PLC0415 - filterpy has loaded it by then

    return float(chi2.isf(_ALARM, freedom)) / freedom
