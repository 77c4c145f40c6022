"""What the studies compute, against other ways to it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from estimator.study import real, simulation, testset


def test_the_mean_error_of_the_test_set_is_that_of_drawn_samples() -> None:
    """Equation 12, sample by sample."""
    scenario = structs.replace(testset.STUDY.read(), test_samples=400)
    off = np.array([[[0.01, -0.02, 0.005, 0.1, -0.2, 0.3]] * 500] * 2)
    raw, corrected = testset.mean_errors(scenario, 0.5, 3, off, np.random.default_rng(1))
    gyro, rng = simulation.gyro_of(scenario.seed, 3), np.random.default_rng(2)
    g = np.full(3, scenario.test_rate_dps / 3**0.5)
    drawn = []
    for _ in range(500):
        m = g / gyro.k + np.degrees(gyro.bias) + 0.5 * rng.normal(size=(400, 3))
        after = (gyro.k + off[0, 0, :3]) * (m - np.degrees(gyro.bias) - off[0, 0, 3:])
        drawn.append([np.mean(g - m, axis=0), np.mean(g - after, axis=0)])
    for found, wanted in zip((raw, corrected[0]), np.swapaxes(drawn, 0, 1), strict=True):
        np.testing.assert_allclose(found.mean(axis=0), wanted.mean(axis=0), atol=0.01)
        np.testing.assert_allclose(found.std(axis=0), wanted.std(axis=0), rtol=0.15)


@pytest.mark.data
def test_a_real_session_agrees_with_imucal(shared_data: Path) -> None:
    """Algorithm 1 and closure to 5e-4, transitions within its own standard deviations; too few poses are said."""
    scenario = structs.replace(real.STUDY.read(), recording=str(shared_data / "imucal" / "ferraris_session.npz"))
    found = real.results(scenario, {})
    by = {row.method: row for row in found.rows}
    theirs = np.array(by["imucal"].k)
    for method in ("turn360", "closure"):
        row = by[method]
        assert row.k is not None
        assert row.closure_deg is not None
        np.testing.assert_allclose(row.k, theirs, atol=5e-4)
        assert max(row.closure_deg) < 0.1
    assert np.all(np.abs(np.array(by["transitions"].k) - theirs) < 3 * np.array(by["transitions"].k_std))
    assert by["accel_aided"].k is None
    assert "different poses" in by["accel_aided"].reason
