"""Standard deviations are enlarged when innovations say so, and only then."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtri

from estimator.track.consistency import WINDOW, Consistency, _most
from estimator.track.evidence import Receipt

Floats = NDArray[np.float64]


def told(innovations: Floats) -> Consistency:
    """After these innovations (n, 3), each said to have variance 1."""
    consistency = Consistency()
    for z in innovations:
        consistency.take(Receipt(0.0, "zaru", z, np.eye(3), 0.0, accepted=True, nis=float(z @ z)))
    return consistency


def test_before_anything_is_known_nothing_is_enlarged() -> None:
    consistency = Consistency()
    assert consistency.inflation == 1.0
    assert np.isnan(consistency.nis)
    assert np.isnan(told(np.ones((9, 3))).whiteness)


def test_good_innovations_seldom_enlarge() -> None:
    rng = np.random.default_rng(0)
    found = [told(rng.normal(size=(WINDOW, 3))) for _ in range(1000)]
    assert sum(c.inflation > 1 for c in found) <= 8
    assert np.mean([c.nis for c in found]) == pytest.approx(1.0, abs=0.02)
    assert np.mean([c.whiteness for c in found]) == pytest.approx(0.0, abs=0.05)


def test_what_counts_as_too_large_is_what_chi_squared_is_above_once_in_a_thousand() -> None:
    freedoms = np.arange(1, 3 * WINDOW + 1)
    assert [_most(int(n)) for n in freedoms] == pytest.approx(chdtri(freedoms, 1e-3) / freedoms, rel=1e-12)


def test_innovations_too_small_enlarge_nothing() -> None:
    assert told(0.1 * np.random.default_rng(0).normal(size=(WINDOW, 3))).inflation == 1.0


def test_innovations_too_large_enlarge_by_as_much() -> None:
    found = [told(3 * np.random.default_rng(seed).normal(size=(WINDOW, 3))).inflation for seed in range(50)]
    assert np.mean(found) == pytest.approx(3.0, rel=0.1)


def test_innovations_that_cling_together_enlarge_though_none_is_large() -> None:
    rng = np.random.default_rng(0)
    walk = np.empty((WINDOW, 3))
    walk[0] = rng.normal(size=3)
    for i in range(1, WINDOW):
        walk[i] = 0.9 * walk[i - 1] + np.sqrt(1 - 0.81) * rng.normal(size=3)
    consistency = told(walk * np.sqrt(3 * WINDOW / np.sum(walk**2)))
    assert consistency.nis == pytest.approx(1.0)
    alike = consistency.whiteness
    assert alike > 0.6
    assert consistency.inflation == pytest.approx(np.sqrt((1 + alike) / (1 - min(alike, 0.9))))


def test_one_outlier_counts_no_more_than_it_may_and_the_past_is_forgotten() -> None:
    good = np.random.default_rng(1).normal(size=(WINDOW, 3))
    wild = good.copy()
    wild[5] = 1e6
    assert told(wild).inflation < 2
    assert told(np.vstack([30 * good, good])).inflation == told(good).inflation
    odd = told(good)
    odd.take(Receipt(0.0, "zaru", np.full(3, np.nan), np.eye(3), np.inf, accepted=False, nis=np.inf))
    assert odd.nis == told(good).nis


def test_what_is_new_is_heard_at_once_and_what_is_forgotten_is_gone() -> None:
    consistency = told(np.full((WINDOW, 3), 3.0))
    large = consistency.inflation
    assert large > 2
    consistency.take(Receipt(0.0, "zaru", np.zeros(3), np.eye(3), 0.0, accepted=True, nis=0.0))
    assert 1 < consistency.inflation < large
    consistency.forget()
    assert consistency.inflation == 1.0
