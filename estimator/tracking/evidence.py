"""Evidence given to the filter, and the receipt of each update; letters as in bias_filter.py."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: largest accepted NIS by degrees of freedom: false alarm 1e-6
GATES = {1: 23.93, 2: 27.63, 3: 30.66}


class Evidence(NamedTuple):
    """A measurement of the filter's state: z (m,) = H (m, n) x + noise of covariance R (m, m).

    kind: name of the kind of evidence, such as `zaru level`. common_var (m,): the part of R that is the same error in
    every measurement; averaging cannot reduce it.
    gate: the largest accepted NIS. soft: beyond the gate R is enlarged until the NIS fits, instead of a refusal.
    """

    kind: str
    z: Floats
    H: Floats
    R: Floats
    gate: float
    common_var: Floats | None = None
    soft: bool = False


class Receipt(NamedTuple):
    """Receipt of a filter update: innovation (m,) = measured - predicted, its covariance, test ratio = NIS / gate.

    time: device time, s. kind: as in `Evidence`. accepted: whether the filter was updated. reason: why it was not, or a
    remark; may be empty.
    """

    time: float
    kind: str
    innovation: Floats
    innovation_cov: Floats
    test_ratio: float
    accepted: bool
    reason: str = ""
    nis: float = float("nan")
