"""Who breathes in sleep turns to and fro: the mean of a long stretch is the bias, as well as it can be known."""

import numpy as np
import pytest

from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import SLOPE, BiasKnobs, Floats, start
from estimator.tracking.bounded_motion import INSIST, VERTICAL_INSIST, BoundedMotion
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second

BIAS = np.radians([1.0, -2.0, 0.5])
N = 104


def breathe(
    off_dps: float | Floats,
    seconds: int,
    swing_deg: float = 1.0,
    seed: int = 0,
    up: Floats | None = None,
    *,
    breath_s: float = 4.3,
    slope_dps: float = 0.0,
    kelvin_per_s: float = 0.0,
) -> tuple[BiasFilter, list[Receipt]]:
    """A sleeper on a device whose bias is believed so much off, to 0.02 °/s; its slope by temperature is known, °/s/K."""
    rng, knobs = np.random.default_rng(seed), BiasKnobs()
    state = start(BIAS + np.radians(off_dps), np.radians(0.02) ** 2 * np.eye(3), 0.0, knobs, temperature_c=20.0)
    state.x[SLOPE] = np.radians(slope_dps)
    state.P[SLOPE, SLOPE] = np.radians(1e-3) ** 2 * np.eye(3)
    bias, bounded, receipts = BiasFilter(state, knobs), BoundedMotion(), []
    way = np.radians(swing_deg) * np.sin(2 * np.pi * np.arange(seconds + 1) / breath_s + rng.uniform(0, 6))
    swung = np.ones(3) if up is None else np.array([1.0, 0.0, 0.0])
    for i in range(seconds):
        warmed = np.radians(slope_dps) * kelvin_per_s * (i + 0.5)
        mean = BIAS + warmed + (way[i + 1] - way[i]) * swung + np.radians(0.03) / np.sqrt(N) * rng.normal(size=3)
        bias.predict(i + 1.0, 20.0 + kelvin_per_s * (i + 1))
        receipts += bounded.take(second_of(mean, i), bias, up)
    return bias, receipts


def second_of(mean: Floats, i: int) -> Second:
    """The second after i s, of that mean rate."""
    std = np.full(3, np.radians(0.03))
    return Second(
        i, i + 1.0, np.full(N, 1 / N), np.tile(mean, (N, 1)), None, False, "", mean, std, std**2 / N, np.zeros(3), std, None, None
    )  # fmt: skip


def swayed(seed: int, settles_s: float) -> Floats:
    """A degree's way (31, 3) at whole seconds, that comes back by chance: Ornstein and Uhlenbeck's."""
    rng, kept = np.random.default_rng([seed, 1]), np.exp(-1 / settles_s)
    way = [rng.normal(size=3)]
    for _ in range(30):
        way.append(kept * way[-1] + np.sqrt(1 - kept**2) * rng.normal(size=3))
    return np.radians(np.array(way))


def test_a_breathing_sleeper_teaches_the_bias_within_its_deviation() -> None:
    scores = []
    for seed in range(20):
        bias, receipts = breathe(0.02, 300, seed=seed)
        assert len(receipts) == 10
        assert all(r.kind == "bounded" and r.accepted for r in receipts)
        scores.append((bias.state.bias - BIAS) / bias.state.std)
    assert np.sqrt(np.mean(np.square(scores))) < 1.3
    assert (bias.state.std < np.radians(0.02)).all()


@pytest.mark.parametrize("settles_s", [3.0, 10.0])
def test_a_sway_without_a_beat_teaches_about_as_much_as_it_is_believed(settles_s: float) -> None:
    scores = []
    for seed in range(60):
        rng, way, bounded = np.random.default_rng(seed), swayed(seed, settles_s), BoundedMotion()
        bias = BiasFilter(start(BIAS, np.radians(1.0) ** 2 * np.eye(3), 0.0, BiasKnobs()), BiasKnobs())
        for i in range(30):
            mean = BIAS + way[i + 1] - way[i] + np.radians(0.03) / np.sqrt(N) * rng.normal(size=3)
            bias.predict(i + 1.0)
            bounded.take(second_of(mean, i), bias)
        scores.append((bias.state.bias - BIAS) / bias.state.std)
    assert 0.5 < np.mean(np.square(scores)) < 1.8


def test_four_stretches_that_contradict_are_believed() -> None:
    bias, receipts = breathe(2.0, 30 * INSIST)
    assert [r.accepted for r in receipts] == [False] * (INSIST - 1) + [True]
    assert receipts[-1].reason == "insisted"
    np.testing.assert_allclose(bias.state.bias, BIAS, atol=3 * np.radians(0.1))
    before, _ = breathe(2.0, 30 * INSIST - 1)
    np.testing.assert_allclose(before.state.bias - BIAS, np.radians(2.0))


@pytest.mark.parametrize("up", [None, np.array([0.0, 0.6, 0.8])], ids=["gyro only", "aided"])
def test_stretches_that_contradict_the_bias_and_each_other_are_not_believed(up: Floats | None) -> None:
    """A bed that turns now so, now so; the fourth was believed whatever the others had said."""
    knobs, bounded, rng = BiasKnobs(), BoundedMotion(), np.random.default_rng(0)
    bias = BiasFilter(start(BIAS, np.radians(0.02) ** 2 * np.eye(3), 0.0, knobs), knobs)
    receipts = []
    for stretch in range(20):
        turned = np.radians([0.5, -1.0, 0.3, 1.5, -0.4][stretch % 5]) * np.array([0.0, 0.6, 0.8])
        for i in range(30 * stretch, 30 * stretch + 30):
            mean = BIAS + turned + np.radians(0.03) / np.sqrt(N) * rng.normal(size=3)
            bias.predict(i + 1.0)
            receipts += bounded.take(second_of(mean, i), bias, up)
    assert not any(r.accepted for r in receipts if r.kind != "bounded level")
    np.testing.assert_allclose(bias.state.bias, BIAS, atol=np.radians(0.01))


@pytest.mark.parametrize("off_dps", [0.1, -0.3, 1.0])
def test_a_bed_that_turns_for_minutes_under_a_sleeper_is_not_taken_for_a_bias(off_dps: float) -> None:
    up = np.array([0.0, 0.6, 0.8])
    minutes = 30 * (VERTICAL_INSIST - 1)
    bias, receipts = breathe(off_dps * up, minutes, 0.5, up=up)
    level, vertical = ([r for r in receipts if r.kind == f"bounded {part}"] for part in ("level", "vertical"))
    assert all(r.accepted for r in level)
    assert not any(r.accepted for r in vertical)
    np.testing.assert_allclose(np.degrees(bias.state.bias - BIAS), off_dps * up, atol=0.01)
    later, _ = breathe(off_dps * up, minutes + 30, 0.5, up=up)
    np.testing.assert_allclose(np.degrees(later.state.bias - BIAS), 0.0, atol=0.05)
