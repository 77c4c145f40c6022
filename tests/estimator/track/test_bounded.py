"""Who breathes in sleep turns to and fro: the mean of a long stretch is the bias, as well as it can be known."""

import numpy as np

from estimator.track.bias_filter import BiasFilter, BiasKnobs, Receipt, start
from estimator.track.bounded import Bounded, BoundedKnobs
from estimator.track.seconds import Second

BIAS = np.radians([1.0, -2.0, 0.5])
N = 104


def breathe(off_dps: float, seconds: int, swing_deg: float = 1.0, seed: int = 0) -> tuple[BiasFilter, list[Receipt]]:
    """A sleeper on a device whose bias is believed so much off, to 0.02 °/s."""
    rng, knobs = np.random.default_rng(seed), BiasKnobs()
    state = start(BIAS + np.radians(off_dps), np.radians(0.02) ** 2 * np.eye(3), 0.0, knobs)
    bias, bounded, receipts = BiasFilter(state, knobs), Bounded(), []
    way = np.radians(swing_deg) * np.sin(2 * np.pi * np.arange(seconds + 1) / 4.3 + rng.uniform(0, 6))
    for i in range(seconds):
        mean = BIAS + (way[i + 1] - way[i]) + np.radians(0.03) / np.sqrt(N) * rng.normal(size=3)
        std, step = np.full(3, np.radians(0.03)), np.full(3, 1e-12)
        second = Second(
            i, i + 1.0, np.full(N, 1 / N), np.tile(mean, (N, 1)), None, False, "", mean, std, step, None, None
        )
        bias.predict(i + 1.0)
        if (receipt := bounded.take(second, bias)) is not None:
            receipts.append(receipt)
    return bias, receipts


def test_a_breathing_sleeper_teaches_the_bias_within_its_deviation() -> None:
    scores = []
    for seed in range(20):
        bias, receipts = breathe(0.02, 300, seed=seed)
        assert len(receipts) == 10
        assert all(r.kind == "bounded" and r.accepted for r in receipts)
        scores.append((bias.state.bias - BIAS) / bias.state.std)
    assert np.sqrt(np.mean(np.square(scores))) < 1.3
    assert (bias.state.std < np.radians(0.02)).all()


def test_a_wider_swing_says_less_and_the_widest_nothing() -> None:
    (little,), (much,) = (breathe(0.0, 30, swing)[1] for swing in (0.5, 4.0))
    assert much.innovation_cov[0, 0] > 4 * little.innovation_cov[0, 0]
    assert breathe(0.0, 30, 15.0)[1] == []


def test_four_stretches_that_contradict_are_believed() -> None:
    insist = BoundedKnobs().insist
    bias, receipts = breathe(2.0, 30 * insist)
    assert [r.accepted for r in receipts] == [False] * (insist - 1) + [True]
    assert receipts[-1].reason == "insisted"
    np.testing.assert_allclose(bias.state.bias, BIAS, atol=3 * np.radians(0.1))
    before, _ = breathe(2.0, 30 * insist - 1)
    np.testing.assert_allclose(before.state.bias - BIAS, np.radians(2.0))
