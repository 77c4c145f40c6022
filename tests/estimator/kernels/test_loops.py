"""Each loop against the same in NumPy's words."""

import numpy as np
import pytest

from estimator.geometry.gyro_model import COARSE_STEP, least_step, mean_var, rounding_var
from estimator.kernels import second_statistics as loop
from estimator.kernels.second_statistics import measured


@pytest.mark.parametrize("coarse", [0.0, 0.25])
@pytest.mark.parametrize("aided", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_readings_of_a_second(seed: int, coarse: float, *, aided: bool) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 120))
    time = np.cumsum(rng.uniform(0.005, 0.015, n))
    gyro, accel = rng.normal(0.0, 0.1, (n, 3)), rng.normal(0.0, 3.0, (n, 3))
    gyro = np.round(gyro / coarse) * coarse if coarse else gyro
    gyro[:, 2] = 0.5
    known = np.full(3, np.inf)
    clipped = np.zeros(n, bool)
    clipped[n // 2] = coarse > 0
    celsius = np.where(rng.random(n) < 0.5, 30.0 + rng.normal(size=n), np.nan) if aided else np.full(n, np.nan)
    samples = np.column_stack([time, gyro, accel if aided else np.full((n, 3), np.nan), clipped, celsius])
    dt, rows, clips = measured(samples, -0.01, 1.0, COARSE_STEP, known)
    assert clips is (coarse > 0)
    np.testing.assert_array_equal(dt, np.diff(time, prepend=-0.01))
    mean, std = gyro.mean(axis=0), gyro.std(axis=0, ddof=1)
    step = least_step(gyro)
    for row, expected in (
        (loop.MEAN, mean),
        (loop.STD, std),
        (loop.STEP, step),
        (loop.MEAN_VAR, mean_var(std, step, n)),
        (loop.COMMON_VAR, rounding_var(std, step)),
        (loop.JITTER, np.diff(gyro, axis=0).std(axis=0, ddof=1)),
        (loop.HELD, [0.0, 0.0, 1.0]),
        *([(loop.ACCEL_MEAN, accel.mean(axis=0)), (loop.ACCEL_STD, accel.std(axis=0, ddof=1))] if aided else []),
        (loop.SCALARS, [0.0, dt.max(), np.linalg.norm(accel, axis=1).mean() if aided else np.nan]),
    ):
        np.testing.assert_allclose(rows[row], expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(known, rows[loop.STEP])
    known_c = celsius[~np.isnan(celsius)]
    assert rows[loop.CELSIUS, 0] == pytest.approx(known_c.mean() if len(known_c) else np.nan, nan_ok=True)
