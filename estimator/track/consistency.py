"""Whether the filter is as sure as it may be: its innovations over some time should be as large as it says, and white."""

from collections import deque
from functools import cache
from math import erfc, exp, isfinite, lgamma, log, pi, sqrt
from operator import mul

from estimator.track.evidence import Receipt

#: receipts that are looked at together
WINDOW = 40
#: chance of a false alarm
_ALARM = 1e-3
#: of a normal distribution, about; where Newton's steps begin, and how many of them find it to rounding
_SIGMAS, _STEPS = 3.09, 5
#: the same for a correlation of n innovations, times root n
_CHANCE = 3.1
#: a single outlier counts no more than this, per degree of freedom
_CAP = 25.0


class Consistency:
    """Receipts in; by how much standard deviations are to be enlarged out."""

    def __init__(self) -> None:
        self._nis: deque[float] = deque(maxlen=WINDOW)
        self._freedoms: deque[int] = deque(maxlen=WINDOW)
        self._signs: deque[float] = deque(maxlen=WINDOW)
        #: None when there is news
        self._inflation: float | None = 1.0
        self._mean = float("nan")

    def take(self, receipt: Receipt) -> None:
        """Note a receipt of a rest."""
        n = len(receipt.innovation)
        if isfinite(receipt.nis):
            self._inflation = None
            self._nis.append(min(receipt.nis, _CAP * n))
            self._freedoms.append(n)
            total = 0.0
            for off, var in zip(receipt.innovation.tolist(), receipt.innovation_cov.diagonal().tolist(), strict=True):
                total += off / sqrt(var)
            self._signs.append(total / n)

    def forget(self) -> None:
        """Begin anew: what was noted has been explained."""
        self._nis.clear()
        self._freedoms.clear()
        self._signs.clear()
        self._inflation, self._mean = 1.0, float("nan")

    @property
    def nis(self) -> float:
        """Mean NIS per degree of freedom; 1 when all is well, NaN before there is any."""
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._mean

    @property
    def whiteness(self) -> float:
        """Correlation of neighbouring innovations, -1 to 1; about 0 when all is well, NaN before there are ten."""
        if len(self._signs) < 10:
            return float("nan")
        signs = tuple(self._signs)
        alike, all_of_it = sum(map(mul, signs[1:], signs)), sum(map(mul, signs, signs))
        return alike / all_of_it if all_of_it > 0.0 else 0.0

    @property
    def inflation(self) -> float:
        """What standard deviations are to be multiplied with: 1, or more when innovations are too large or cling together."""
        if self._inflation is None:
            self._inflation = self._inflated()
        return self._inflation

    def _inflated(self) -> float:
        freedom = sum(self._freedoms)
        self._mean = nis = sum(self._nis) / freedom
        # Smaller than they may be: where noise is put too high, as of quiet seconds that may be no rest, the filter is surer than
        # it says, however much of what is left of them clings together.
        large = nis if nis > _most(freedom) else min(1.0, nis)
        alike = self.whiteness
        # Neighbours that agree by more than chance: so many fewer of them are news.
        clinging = (1 + alike) / (1 - min(alike, 0.9)) if alike > _CHANCE / sqrt(len(self._signs)) else 1.0
        return sqrt(max(1.0, large * clinging))


@cache
def _most(freedom: int) -> float:
    """What chi² per degree of freedom is above by chance only: Newton's steps from Wilson and Hilferty's approximation.

    scipy has it, but takes a third of a second to load: at a restart, before the first sample is corrected.
    """
    spread = 2 / (9 * freedom)
    half = freedom / 2 * (1 - spread + _SIGMAS * sqrt(spread)) ** 3
    for _ in range(_STEPS):
        density = exp((freedom / 2 - 1) * log(half) - half - lgamma(freedom / 2))
        half += (_above(half, freedom) - _ALARM) / density
    return 2 * half / freedom


def _above(half: float, freedom: int) -> float:
    """That chi² is above twice `half` (Abramowitz and Stegun 26.4.4, 26.4.5)."""
    odd = freedom % 2
    term = exp(-half) * (2 * sqrt(half / pi) if odd else 1.0)
    total = erfc(sqrt(half)) if odd else 0.0
    for r in range(1, freedom // 2 + 1):
        total += term
        term *= half / (r + odd / 2)
    return total
