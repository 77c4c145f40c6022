"""Each loop against the same in NumPy's words."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.geometry.gyro_model import COARSE_STEP, least_step, mean_var, rounding_var, spread
from estimator.geometry.rotation import cross_matrix
from estimator.kernels import second_statistics as loop
from estimator.kernels import strapdown as loops
from estimator.kernels.gravity import carried
from estimator.kernels.second_statistics import measured
from estimator.kernels.strapdown import summed

Floats = NDArray[np.float64]
UP = np.array([0.0, 0.0, 9.8])


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
    mean, std = spread(gyro)
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


def test_the_state_goes_on_over_a_span_as_the_equations_say() -> None:
    rng = np.random.default_rng(4)
    n, matrix = 400, np.eye(3) + 0.05 * rng.normal(size=(3, 3))
    dt, gyro, accel = rng.uniform(0.001, 0.003, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) + UP
    g, v = rng.normal(size=3) + UP, rng.normal(size=3)
    length, kept, T = float(np.linalg.norm(g)), 0.9, float(dt.sum())

    def gone_on(error: Floats) -> Floats:
        """Gravity and velocity after it, of a state that is off by so much."""
        rows = summed(dt, gyro, accel, matrix, error[:3], error[12:15], error[15:])
        end, push = rows[loops.END], rows[loops.PUSH]
        return np.concatenate([end.T @ (g + error[6:9]), end.T @ (v + error[9:12] + push - (g + error[6:9]) * T)])

    span = summed(dt, gyro, accel, matrix, np.zeros(3), np.zeros(3), np.zeros(9))
    assert span[loops.SCALARS, 0] == pytest.approx(T)
    x = np.concatenate([np.zeros(6), g, v, np.zeros(12)])
    turned, pushed, posed = 1e-4, 2e-3, 3e-2
    moved, F, Q = carried(x, np.zeros((24, 24)), span, kept, length, (turned, pushed, posed))
    np.testing.assert_allclose(moved[6:12], gone_on(np.zeros(24)), rtol=1e-9)
    step = 1e-5
    slopes = np.array([(gone_on(step * e) - gone_on(-step * e)) / (2 * step) for e in np.eye(24)]).T
    rest = np.delete(np.arange(24), [3, 4, 5])
    # What a sample turns moves all of its own push too: so much is left of steps of 2 ms.
    np.testing.assert_allclose(F[6:12][:, rest], slopes[:, rest], atol=0.02)
    expected = np.eye(24)
    expected[6:12] = F[6:12]
    expected[12:15, 12:15] *= kept
    np.testing.assert_array_equal(F, expected)
    by_turn = np.zeros((24, 3))
    by_turn[6:9] = span[loops.END].T @ cross_matrix(g)
    by_turn[9:12] = -T / 2 * by_turn[6:9]
    added = turned * by_turn @ by_turn.T + np.diag(np.repeat([0.0, 0.0, 0.0, pushed, posed, 0.0, 0.0, 0.0], 3))
    np.testing.assert_allclose(Q, added, atol=1e-15)
