"""The smoother against a least squares of all of the walk at once."""

import numpy as np

from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, BiasKnobs, Floats, start
from estimator.tracking.evidence import Evidence
from estimator.tracking.smoother import History

WALK, NOISE, PRIOR = 1e-3, 3e-3, 0.1
KNOBS = BiasKnobs(rate_random_walk=WALK, per_kelvin=1e-6)


def walked(m: int, most: int | None = None, seed: int = 0) -> tuple[History, Floats]:
    """m seconds of a bias that walks, measured each; the history of a filter of it, and what was measured (m, 3)."""
    rng = np.random.default_rng(seed)
    z = np.cumsum(WALK * rng.normal(size=(m, 3)), axis=0) + NOISE * rng.normal(size=(m, 3))
    bias, history = BiasFilter(start(np.zeros(3), PRIOR**2 * np.eye(3), 0.0, KNOBS), KNOBS), History(most)
    for i in range(m):
        steps = bias.predict(i + 1.0)
        assert steps is not None
        bias.update(Evidence("zaru", z[i], np.eye(3, OWN), NOISE**2 * np.eye(3), 1e9))
        history.add(i + 1.0, bias.x, bias.cov, steps)
    return history, z


def least_squares(z: Floats, extra: Floats | None = None) -> tuple[Floats, Floats]:
    """(m, 3) the best walk through measurements, and its deviation (m,); extra (m,): variance more of a step."""
    m = len(z)
    steps = np.full(m, WALK**2) + (0.0 if extra is None else extra)
    steps[0] += PRIOR**2
    D = np.eye(m) - np.eye(m, k=-1)
    cov = np.linalg.inv(D.T @ np.diag(1 / steps) @ D + np.eye(m) / NOISE**2)
    return cov @ z / NOISE**2, np.sqrt(np.diag(cov))


def test_it_is_the_least_squares_of_all_at_once() -> None:
    history, z = walked(60)
    smoothed = history.smoothed()
    assert smoothed is not None
    best, std = least_squares(z)
    np.testing.assert_allclose(smoothed.bias, best, atol=1e-9)
    np.testing.assert_allclose(smoothed.std, np.tile(std[:, None], 3), rtol=1e-5)
    np.testing.assert_array_equal(smoothed.time, np.arange(1, 61))
    late = history.smoothed(since=40.0)
    assert late is not None
    np.testing.assert_allclose(late.bias, best[40:], atol=1e-9)
    assert history.smoothed(since=60.0) is None


def test_thinning_keeps_both_ends_and_changes_nothing_of_what_is_left() -> None:
    for m in (129, 130, 200, 255):
        (thin, _), (whole, _) = walked(m, most=64), walked(m)
        few, all_ = thin.smoothed(), whole.smoothed()
        assert few is not None
        assert all_ is not None
        assert len(few.time) <= 64
        assert (few.time[0], few.time[-1]) == (1.0, m)
        at = few.time.astype(int) - 1
        np.testing.assert_allclose(few.std[-1], all_.std[-1], rtol=1e-6)
        np.testing.assert_allclose(few.bias[-1], all_.bias[-1], atol=1e-9)
        assert (np.diff(few.time) >= 1).all()
        assert (few.std > 0.99 * all_.std[at]).all(), "what is left out is no longer known"
