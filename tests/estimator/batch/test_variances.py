import numpy as np
import pytest

from estimator.batch.variances import Floats, Linear, factors


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


def test_an_error_below_the_noise_is_not_told_from_none() -> None:
    found = factors(drawn(np.random.default_rng(2), np.array([0.0, 0.5, 0.5])))
    assert np.sqrt(found[0]) < 0.01


def test_of_what_no_residual_shows_the_assumption_stays() -> None:
    of = drawn(np.random.default_rng(3), np.array([0.5, 0.5, 0.5]))
    parts = of.parts.copy()
    parts[2] = 0.0
    unseen = factors(Linear(of.r, of.J, of.noise + of.parts[2], parts, of.information, of.gradient))
    assert unseen[2] == pytest.approx(1.0, rel=0.02)


def test_few_residuals_leave_it_wider_than_many() -> None:
    ratio = []
    for seed in range(30):
        few = drawn(np.random.default_rng(seed), np.array([0.3, 0.3, 0.3]), n=24)
        ratio.append(np.mean(factors(few)) / 0.09)
    assert np.mean(ratio) > 1.1


def test_the_steps_end_where_the_posterior_is_greatest() -> None:
    of = drawn(np.random.default_rng(4), np.array([0.4, 0.2, 0.6]))
    best = of.likeliest()
    highest = of.log_posterior(best)
    for kind in range(3):
        for step in (-0.2, 0.2):
            assert of.log_posterior(best + step * np.eye(3)[kind]) < highest
