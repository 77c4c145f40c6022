"""Accelerometer calibration from mean readings in poses: against SciPy's own least squares, the truth, and refusals."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator.calibration.accelerometer import calibrated, in_use

Floats = NDArray[np.float64]
G = 9.80665
FACES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Drawn:
    """An accelerometer with errors, in n poses: six faces, each tilted a little, and others in any direction."""

    poses: Floats
    bias: Floats
    scale: Floats
    up: Floats


def drawn(seed: int, n: int = 12, *, shear: float = 0.0, off: float = 0.01) -> Drawn:
    rng = np.random.default_rng(seed)
    up = np.vstack([FACES + 0.1 * rng.normal(size=(6, 3)), rng.normal(size=(n - 6, 3))])
    up /= np.linalg.norm(up, axis=1)[:, None]
    across = shear * rng.normal(size=3)
    shape = np.array([[1, across[2], across[1]], [across[2], 1, across[0]], [across[1], across[0], 1]])
    bias, scale = rng.uniform(-0.4, 0.4, 3), rng.uniform(0.98, 1.02, 3)
    mean = G * up @ np.linalg.inv(shape) / scale + bias + off * rng.normal(size=(n, 3))
    return Drawn(np.column_stack([np.full(n, 1e-6), mean]), bias, scale, up)


def test_it_is_what_scipy_finds() -> None:
    """All poses count alike here, as axes that take nothing from each other leave equal errors."""
    poses = drawn(1, 40).poses
    found = calibrated(poses)
    plain = least_squares(
        lambda x: np.linalg.norm(x[3:] * (poses[:, 1:] - x[:3]), axis=1) - G, [0, 0, 0, 1, 1, 1], xtol=1e-12
    )
    assert found.verdict is Verdict.ACCEPTED
    assert (np.abs(plain.x - [*found.bias, *found.scale]) < 0.7 * np.array(found.std)).all()
    # The standard deviations of a fit that knows the noise only.
    known = 0.01 * np.sqrt(np.diag(np.linalg.inv(plain.jac.T @ plain.jac)))
    assert (np.array(found.std) > 0.9 * known).all()
    assert (np.array(found.std) < 2.0 * known).all()


@pytest.mark.parametrize("shear", [0.0, 0.003])
def test_the_covariance_is_honest(shear: float) -> None:
    nees, across = [], []
    for seed in range(60):
        one = drawn(seed, 8 + seed % 8, shear=shear)
        found = calibrated(one.poses)
        error = np.array([*found.bias, *found.scale]) - [*one.bias, *one.scale]
        nees.append(error @ np.linalg.solve(np.reshape(found.covariance, (6, 6)), error) / 6)
        # A corrected reading is wrong by what `in_use` tells, over many directions.
        up = np.random.default_rng(seed).normal(size=(50, 3))
        up *= G / np.linalg.norm(up, axis=1)[:, None]
        left = np.array(found.scale) * (up / one.scale + one.bias - found.bias) - up
        across.append(np.mean((left / in_use(found)[6:]) ** 2))
    assert 0.7 < np.mean(nees) < 1.3
    assert np.mean(across) < 1.2


def without_z(poses: Floats) -> Floats:
    """All poses with z in the horizon: nothing shows its scale."""
    flat = poses.copy()
    flat[:, 3] = 0.3
    return flat


@pytest.mark.parametrize(
    ("poses", "verdict", "code"),
    [
        (drawn(2).poses[:5], Verdict.REPEAT, Code.TOO_FEW_POSES),
        (drawn(2).poses[[0, 0, 0, 0, 0, 0, 1, 2]], Verdict.REPEAT, Code.ACCELEROMETER_UNCERTAIN),
        (without_z(drawn(2).poses), Verdict.REPEAT, Code.ACCELEROMETER_UNCERTAIN),
        (drawn(2).poses * [1, 0.85, 0.85, 0.85], Verdict.REFUSED, Code.ACCELEROMETER_NOT_GRAVITY),
        (drawn(2, 20, off=0.3).poses, Verdict.REPEAT, Code.ACCELEROMETER_UNCERTAIN),
        (drawn(2, 400, off=0.3).poses, Verdict.REFUSED, Code.ACCELEROMETER_MISFIT),
    ],
)
def test_what_determines_nothing_or_is_no_gravity_is_refused(poses: Floats, verdict: Verdict, code: Code) -> None:
    found = calibrated(poses)
    assert (found.verdict, found.reason[0].code, found.poses) == (verdict, code, len(poses))
    assert found.bias == found.scale == found.covariance == ()
