"""What a filter is given, and what it says of it: the letters are those of bias_filter.py."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: the largest believable NIS by degrees of freedom: false alarm 1e-6
GATES = {1: 23.93, 2: 27.63, 3: 30.66}


class Evidence(NamedTuple):
    """A measurement z (m,) = H (m, n) x, with covariance R (m, m).

    common_var (m,): the part of R that is the same error in every measurement; no number of them gets below it.
    gate: the largest NIS believed. soft: beyond it R grows until it is not, and nothing is refused.
    """

    kind: str
    z: Floats
    H: Floats
    R: Floats
    gate: float
    common_var: Floats | None = None
    soft: bool = False


class Receipt(NamedTuple):
    """What one piece of evidence did: innovation (m,) = measured - predicted, its covariance, test ratio = NIS / gate."""

    time: float
    kind: str
    innovation: Floats
    innovation_cov: Floats
    test_ratio: float
    accepted: bool
    reason: str = ""
    nis: float = float("nan")
