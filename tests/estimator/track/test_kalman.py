"""filterpy as we have it: what it has not imported yet it imports when it is used, and nobody notices; what it keeps."""

import subprocess
import sys

import numpy as np
import pytest

from estimator.track.kalman import KalmanFilter

CODE = """
import sys
from estimator.service import shell
from estimator.track.kalman import KalmanFilter
parts = ("linalg", "ndimage", "optimize", "sparse", "spatial", "special", "stats")
assert not [part for part in parts if f"scipy.{part}" in sys.modules], "the estimator waits for them"

import numpy as np
kf = KalmanFilter(dim_x=1, dim_z=1)
kf.H, kf.P, kf.R = np.eye(1), np.eye(1), 3 * np.eye(1)
kf.update(np.array([1.0]))
from scipy.stats import norm
assert kf.log_likelihood == norm.logpdf(1.0, 0.0, 2.0) < 0

from filterpy.discrete_bayes import predict
from filterpy.stats import multivariate_gaussian
assert np.allclose(predict([0.0, 1.0, 0.0], 1, [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0])
assert np.isclose(multivariate_gaussian(0.5, 0.0, 1.0), norm.pdf(0.5))
"""


def test_what_is_imported_late_is_the_same() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("measured", [np.array([[2.0]]), 2.0, [2.0], [[2.0]]])
def test_the_last_measurement_is_kept_as_it_was(measured: object) -> None:
    kf = KalmanFilter(dim_x=1, dim_z=1)
    kf.H = np.eye(1)
    kf.update(measured)
    if isinstance(measured, np.ndarray):
        measured[:] = 3.0
    assert np.array(kf.z).item() == 2.0
