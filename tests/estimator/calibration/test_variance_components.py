import numpy as np
import pytest

from estimator.calibration.variance_components import Floats, Linear, factors


def drawn(rng: np.random.Generator, s: Floats, n: int = 90) -> Linear:
    """Residuals of three kinds of errors, a third of the rows each, of standard deviations s over noise of 0.01."""
    J = rng.normal(size=(n, 9))
    parts = np.array([np.diag((np.arange(n) % 3 == kind).astype(float)) for kind in range(3)])
    r = J @ rng.normal(size=9) + 0.01 * rng.normal(size=n) + np.tensordot(s, parts, axes=1) @ rng.normal(size=n)
    return Linear(r, J, 1e-4 * np.eye(n), parts, np.eye(9), np.zeros(9))


@pytest.mark.parametrize("s", [(0.1, 0.5, 0.3), (0.5, 0.1, 1.0), (2.0, 1.0, 0.7)])
def test_each_kind_is_found_as_large_as_it_is(s: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    found = np.mean([np.sqrt(factors(drawn(rng, np.array(s)))) for _ in range(12)], axis=0)
    np.testing.assert_allclose(found, s, rtol=0.2)


def test_of_what_no_residual_shows_the_assumption_stays() -> None:
    of = drawn(np.random.default_rng(3), np.array([0.5, 0.5, 0.5]))
    parts = of.parts.copy()
    parts[2] = 0.0
    unseen = factors(Linear(of.r, of.J, of.noise + of.parts[2], parts, of.information, of.gradient))
    assert unseen[2] == pytest.approx(1.0, rel=0.02)
