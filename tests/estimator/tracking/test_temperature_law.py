"""The temperature law: learnt from simulated boots, followed by the filter, smoothed, and given up when it is wrong."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import BIAS, OWN, SLOPE, BiasKnobs, start
from estimator.tracking.evidence import Evidence
from estimator.tracking.smoother import History
from estimator.tracking.temperature_law import Floats, TemperatureLaw
from estimator.tracking.temperature_learning import Points, learn

KNOBS = BiasKnobs()
LAW = TemperatureLaw(
    28.0,
    np.radians([0.02, -0.015, 0.0]),
    np.radians([3e-4, 0.0, -4e-4]),
    np.tile(np.diag(np.radians([1e-3, 5e-5]) ** 2), (3, 1, 1)),
)
STD = np.radians(0.005)


def warm_up(minutes: int = 120, to_c: float = 33.0) -> Floats:
    return to_c - 10.0 * np.exp(-np.arange(minutes) / 10.0)


def boot(rng: np.random.Generator, law: TemperatureLaw = LAW, celsius: Floats | None = None) -> Points:
    """Tracked biases, a minute apart, of a boot with an offset and a walk of its own; each with an error of its own."""
    celsius = warm_up() if celsius is None else celsius
    time = 60.0 * np.arange(len(celsius), dtype=float)
    walk = np.cumsum(KNOBS.rate_random_walk * np.sqrt(60.0) * rng.normal(size=(len(time), 3)), axis=0)
    bias = np.radians(3.0) * rng.normal(size=3) + walk
    bias += np.array([law.change(law.reference_c, one) for one in celsius]).reshape(-1, 3)
    return Points(time, bias + STD * rng.normal(size=bias.shape), np.full(bias.shape, STD), celsius)


def learnt(boots: Sequence[Points]) -> TemperatureLaw:
    law = learn(boots, KNOBS)
    assert law is not None
    return law


def drawn(rng: np.random.Generator) -> TemperatureLaw:
    """A device as parts are made."""
    linear, quadratic = KNOBS.per_kelvin * rng.normal(size=3), KNOBS.curvature / 2 * rng.normal(size=3)
    return TemperatureLaw(28.0, linear, quadratic, np.zeros((3, 2, 2)))


# ---- learning -----------------------------------------------------------------------------------------------------


def test_boots_with_offsets_and_a_walk_tell_the_law() -> None:
    rng = np.random.default_rng(1)
    law = learnt([boot(rng) for _ in range(8)])
    for celsius in (24.0, 28.0, 32.0):
        error = law.slope(celsius) - LAW.slope(celsius)
        assert np.all(np.abs(error) < 4 * np.sqrt(law.slope_var(celsius)))
        assert np.degrees(np.abs(error)).max() < 0.004
    one = learnt([boot(rng)])
    assert np.all(law.slope_var(28.0) < one.slope_var(28.0) / 3)


@pytest.mark.parametrize("boots", [1, 4])
def test_it_is_as_sure_as_it_may_be(boots: int) -> None:
    rng, nees = np.random.default_rng(boots), []
    for _ in range(25):
        truth = drawn(rng)
        law = learnt([boot(rng, truth) for _ in range(boots)])
        there = truth.linear + 2 * (law.reference_c - truth.reference_c) * truth.quadratic
        for axis in range(3):
            error = np.array([law.linear[axis] - there[axis], law.quadratic[axis] - truth.quadratic[axis]])
            nees.append(error @ np.linalg.solve(law.cov[axis], error))
    low, high = chi2.ppf([0.001, 0.999], 2 * len(nees)) / len(nees)
    # Boots that disagree by chance are not told from those that do in earnest: a little too unsure, never too sure.
    assert 0.6 * low < np.mean(nees) < high


def test_a_boot_that_disagrees_widens_it() -> None:
    rng = np.random.default_rng(4)
    good = [boot(rng) for _ in range(4)]
    other = replace(LAW, linear=LAW.linear + np.radians(0.04))
    before, after = learnt(good), learnt([*good, boot(rng, other)])
    assert np.all(after.slope_var(28.0) > 2 * before.slope_var(28.0))
    assert np.all(np.abs(after.slope(28.0) - LAW.slope(28.0)) < 4 * np.sqrt(after.slope_var(28.0)))


def test_what_was_only_predicted_is_no_news() -> None:
    """A bias that no evidence has told anything of follows the law that was used: it must not confirm it."""
    rng = np.random.default_rng(6)
    before = learnt([boot(rng)])
    celsius = warm_up()
    time = 60.0 * np.arange(len(celsius), dtype=float)
    bias = np.array([before.change(celsius[0], one) for one in celsius])
    std = np.sqrt(STD**2 + KNOBS.rate_random_walk**2 * time)[:, None] * np.ones(3)
    assert learn([Points(time, bias, std, celsius)], KNOBS) is None


def test_no_damage_in_the_record_stops_a_device() -> None:
    rng = np.random.default_rng(7)
    whole = boot(rng)
    for broken in (
        replace(whole, std=np.zeros_like(whole.std)),
        replace(whole, time=np.zeros_like(whole.time)),
        replace(whole, time=whole.time[::-1]),
    ):
        law = learn([broken, whole], KNOBS)
        assert law is not None
        assert np.all(np.isfinite(law.cov))


# ---- following ----------------------------------------------------------------------------------------------------


def following(law: TemperatureLaw | None, celsius: float = 23.0) -> BiasFilter:
    """A filter of a bias that is known, at a temperature."""
    bias = BiasFilter(start(np.zeros(3), 1e-12 * np.eye(3), 0.0, KNOBS, temperature_c=celsius))
    if law is not None:
        bias.expect(law)
    return bias


def seen(z: Floats) -> Evidence:
    return Evidence("zaru", z, np.eye(3, OWN), STD**2 * np.eye(3), np.inf)


@pytest.mark.parametrize("steps", [1, 10, 1000])
def test_a_bias_follows_the_law_in_steps_of_any_size(steps: int) -> None:
    bias = following(LAW)
    for i in range(steps):
        bias.predict(float(i + 1), 23.0 + 10.0 * (i + 1) / steps)
    np.testing.assert_allclose(bias.x[BIAS], LAW.change(23.0, 33.0), atol=1e-12)
    np.testing.assert_allclose(bias.x[SLOPE], LAW.slope(33.0), atol=1e-12)
    walked = KNOBS.rate_random_walk**2 * steps
    known = np.diag(bias.cov)[BIAS] - walked
    assert np.all(known < 1.5 * 10.0**2 * LAW.slope_var(23.0))


def test_only_a_wrong_law_is_refuted() -> None:
    rng = np.random.default_rng(3)
    wrong = replace(LAW, linear=-LAW.linear)
    most = {"right": 0.0, "wrong": 0.0}
    for name, law in (("right", LAW), ("wrong", wrong)):
        bias = following(law)
        for i, celsius in enumerate(warm_up(100)):
            bias.predict(60.0 * (i + 1), celsius)
            bias.update(seen(LAW.change(23.0, celsius) + STD * rng.normal(size=3)))
            most[name] = max(most[name], bias.against_law)
        before = np.diag(bias.cov)[SLOPE].copy()
        np.testing.assert_allclose(np.diag(bias.unlearn()), KNOBS.per_kelvin**2)
        np.testing.assert_allclose(np.diag(bias.cov)[SLOPE], before + KNOBS.per_kelvin**2)
        assert bias.against_law == 0.0
    assert most["right"] < 4 < most["wrong"]


def test_smoothing_takes_the_law_along() -> None:
    """Between two rests, nothing but the law tells the bias: a smoother that did not know of it would draw a line."""
    bent = replace(LAW, quadratic=np.radians([1e-3, -1e-3, 2e-3]))
    for most in (None, 16):
        bias, history = following(bent), History(most)
        for i in range(100):
            celsius = 23.0 + 0.1 * (i + 1)
            steps = bias.predict(float(i + 1), celsius)
            assert steps is not None
            if i in (0, 99):
                bias.update(Evidence("zaru", bent.change(23.0, celsius), np.eye(3, OWN), 1e-14 * np.eye(3), np.inf))
            history.add(bias.time, bias.x, bias.cov, steps, bias.bent)
        smoothed = history.smoothed()
        assert smoothed is not None
        truth = np.array([bent.change(23.0, 23.0 + 0.1 * time) for time in smoothed.time])
        np.testing.assert_allclose(smoothed.bias, truth, atol=np.radians(1e-5))
