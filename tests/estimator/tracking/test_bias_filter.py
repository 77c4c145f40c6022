from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, SLOPE, BiasKnobs, Floats
from estimator.tracking.bias_state import start as begin
from estimator.tracking.evidence import GATES, Evidence

SMALL = np.eye(3) * 1e-8
NAN = float("nan")


def start(var: float = 1e-6, temperature: float = NAN, knobs: BiasKnobs | None = None) -> BiasFilter:
    knobs = knobs or BiasKnobs()
    state = begin(np.array([0.1, -0.2, 0.0]), var * np.eye(3), 10.0, knobs, temperature_c=temperature)
    return BiasFilter(state, knobs)


def seen(z: Floats, R: Floats, common_var: Floats | None = None, *, soft: bool = False) -> Evidence:
    """The bias as it is."""
    return Evidence("zaru", z, np.eye(3, OWN), R, GATES[3], common_var, soft)


def test_one_update_is_the_textbooks() -> None:
    bias = start(4e-6)
    z, R = np.array([0.101, -0.2, 0.002]), np.diag([1e-6, 4e-6, 16e-6])
    receipt = bias.update(seen(z, R))
    gain = 4e-6 / (4e-6 + np.diag(R))
    np.testing.assert_allclose(bias.state.bias, [0.1 + gain[0] * 0.001, -0.2, gain[2] * 0.002])
    np.testing.assert_allclose(np.diag(bias.state.bias_cov), (1 - gain) * 4e-6)
    np.testing.assert_allclose(receipt.innovation, [0.001, 0.0, 0.002])
    np.testing.assert_allclose(receipt.innovation_cov, 4e-6 * np.eye(3) + R)
    nis = 0.001**2 / 5e-6 + 0.002**2 / 20e-6
    assert receipt.nis == pytest.approx(nis)
    assert receipt.test_ratio == pytest.approx(nis / GATES[3])
    assert receipt.accepted
    assert (receipt.kind, receipt.time) == ("zaru", 10.0)


@pytest.mark.parametrize("powered", [-np.inf, 4.0])
def test_it_walks_with_time_however_often_it_is_asked(powered: float) -> None:
    knobs = BiasKnobs()
    once, often = (BiasFilter(replace(start().state, powered=powered)) for _ in range(2))
    once.predict(110.0)
    for time in np.linspace(10.0, 110.0, 501)[1:]:
        often.predict(float(time))
    warming = np.exp(-6.0 / knobs.warm_up_s) - np.exp(-106.0 / knobs.warm_up_s)
    extra = knobs.warm_up_walk**2 * knobs.warm_up_s * warming if np.isfinite(powered) else 0.0
    np.testing.assert_allclose(np.diag(once.state.bias_cov), 1e-6 + knobs.rate_random_walk**2 * 100 + extra)
    np.testing.assert_allclose(often.state.P, once.state.P)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("soft", [False, True])
def test_what_is_not_finite_never_gets_in(bad: float, soft: bool) -> None:
    for place in range(3):
        bias = start()
        before = bias.state
        z = before.bias.copy()
        z[place] = bad
        assert not bias.update(seen(z, SMALL, soft=soft)).accepted
        R = SMALL.copy()
        R[place, place] = bad
        assert not bias.update(seen(before.bias, R, soft=soft)).accepted
        np.testing.assert_array_equal(bias.state.x, before.x)
        np.testing.assert_array_equal(bias.state.P, before.P)
    assert bias.update(seen(before.bias, SMALL)).accepted


@pytest.mark.parametrize("R", [SMALL, 1e-4 * SMALL], ids=["as the state", "far surer than the state"])
def test_beyond_a_soft_gate_a_measurement_weighs_less(R: Floats) -> None:
    hard, soft, within = start(), start(), start()
    far = np.array([0.0, 0.02, 0.0])
    refused = hard.update(seen(hard.state.bias + far, R))
    ratio = refused.test_ratio
    assert ratio > 10
    before = soft.state
    taken = soft.update(seen(before.bias + far, R, soft=True))
    assert taken.accepted
    assert taken.test_ratio == ratio
    larger = R + (ratio * (1 + 1e-9) - 1) * refused.innovation_cov
    assert within.weigh(seen(before.bias + far, larger)).test_ratio == pytest.approx(1.0)
    within.update(seen(before.bias + far, larger))
    np.testing.assert_allclose(soft.state.P, within.state.P, rtol=1e-6)
    np.testing.assert_allclose(soft.state.x, within.state.x, rtol=1e-6)
    moved = soft.state.bias - before.bias
    assert moved @ np.linalg.solve(before.bias_cov, moved) < GATES[3]


def test_gates_let_one_good_measurement_in_a_million_out() -> None:
    for freedom, gate in GATES.items():
        assert chi2.sf(gate, freedom) == pytest.approx(1e-6, rel=0.01)


def test_a_slope_is_learnt_from_two_temperatures_and_used_at_a_third() -> None:
    knobs = BiasKnobs(rate_random_walk=1e-9)
    bias = start(temperature=25.0, knobs=knobs)
    slope = np.array([1e-4, -3e-4, 0.0])
    at25 = bias.state.bias
    bias.update(seen(at25, SMALL * 1e-2))
    bias.predict(100.0, 30.0)
    assert bias.update(seen(at25 + 5 * slope, SMALL * 1e-2)).accepted
    np.testing.assert_allclose(bias.state.x[SLOPE], slope, atol=5e-6)
    bias.predict(200.0, 32.0)
    np.testing.assert_allclose(bias.state.bias, at25 + 7 * slope, atol=2e-5)
    # It may bend: what lies far beyond is less certain, but not as if nothing were known.
    bias.predict(300.0, 45.0)
    std_k = bias.state.std[0] / (13 * knobs.per_kelvin)
    assert knobs.curvature * 13 / knobs.per_kelvin / 3 < std_k < 0.7


def test_an_error_common_to_all_measurements_is_not_averaged_away() -> None:
    bias, common = start(), np.array([0.0, 4e-8, 0.0])
    for _ in range(1000):
        assert bias.update(seen(bias.state.bias, SMALL + np.diag(common), common)).accepted
    assert bias.state.P[0, 0] < 1e-10
    assert bias.state.P[1, 1] == pytest.approx(4e-8)
