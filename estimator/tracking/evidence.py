"""Evidence (a measurement for the bias filter), and the receipt of each update.

Letters: measurement z with covariance R and observation matrix H, state x (bias in rad/s first).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: largest accepted NIS by degrees of freedom: false alarm 1e-6
GATES = {1: 23.93, 2: 27.63, 3: 30.66}


class Evidence(NamedTuple):
    """Measurement of the filter's state: z (m,) = H (m, n) x + noise of covariance R (m, m).

    Units: z as the kind of evidence (rad/s for a bias, m/s for a velocity), R their square.
    kind: name of the kind of evidence, such as `zaru level`.
    common_var (m,): variance of the error that is the same in every measurement, part of R; averaging cannot reduce it.
    gate: largest accepted NIS.
    soft: True to enlarge R beyond the gate until the NIS fits, instead of refusing the measurement.
    """

    kind: str
    z: Floats
    H: Floats
    R: Floats
    gate: float
    common_var: Floats | None = None
    soft: bool = False


class Receipt(NamedTuple):
    """Receipt of a filter update: innovation (m,) = measured - predicted, its covariance (m, m), and test ratio NIS / gate.

    Units: innovation as the measurement (rad/s or m/s), covariance its square.
    time: device time, s. kind: as in `Evidence`.
    accepted: True if the filter was updated.
    reason: why it was not updated, or a remark; may be empty.
    nis: normalised innovation squared, no unit.
    """

    time: float
    kind: str
    innovation: Floats
    innovation_cov: Floats
    test_ratio: float
    accepted: bool
    reason: str = ""
    nis: float = float("nan")
