"""Standard deviations are enlarged when innovations say so, and only then."""

import numpy as np
import pytest

from estimator.tracking.evidence import Floats, Receipt
from estimator.tracking.innovation_consistency import WINDOW, InnovationConsistency


def told(innovations: Floats) -> InnovationConsistency:
    """After these innovations (n, 3), each said to have variance 1."""
    consistency = InnovationConsistency()
    for z in innovations:
        consistency.take(Receipt(0.0, "zaru", z, np.eye(3), 0.0, accepted=True, nis=float(z @ z)))
    return consistency


def test_good_innovations_seldom_enlarge() -> None:
    rng = np.random.default_rng(0)
    found = [told(rng.normal(size=(WINDOW, 3))) for _ in range(1000)]
    assert sum(c.inflation > 1 for c in found) <= 8
    assert np.mean([c.mean_nis for c in found]) == pytest.approx(1.0, abs=0.02)
    assert np.mean([c.whiteness for c in found]) == pytest.approx(0.0, abs=0.05)


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
    assert consistency.mean_nis == pytest.approx(1.0)
    alike = consistency.whiteness
    assert alike > 0.6
    assert consistency.inflation == pytest.approx(np.sqrt((1 + alike) / (1 - min(alike, 0.9))))
