from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from estimator.track.bias_filter import BIAS, OWN, SLOPE, BiasFilter, BiasKnobs
from estimator.track.bias_filter import start as begin
from estimator.track.evidence import GATES, Evidence
from estimator.track.temperature import TemperatureLaw

Floats = NDArray[np.float64]
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


def test_weighing_says_what_an_update_would_and_changes_nothing() -> None:
    bias = start()
    evidence = seen(np.array([0.101, -0.2, 0.002]), SMALL)
    before = bias.state
    weighed = bias.weigh(evidence)
    np.testing.assert_array_equal(bias.state.x, before.x)
    np.testing.assert_array_equal(bias.state.P, before.P)
    taken = bias.update(evidence)
    assert taken.accepted == weighed.accepted
    assert (taken.nis, taken.test_ratio) == pytest.approx((weighed.nis, weighed.test_ratio))


@pytest.mark.parametrize("m", [1, 2, 3])
def test_evidence_of_any_size_is_weighed_by_its_own_covariance(m: int) -> None:
    rng = np.random.default_rng(m)
    bias, H, root = start(), rng.normal(size=(m, OWN)), rng.normal(size=(m, m))
    evidence = Evidence("any", rng.normal(size=m), H, 1e-6 * (root @ root.T + np.eye(m)), 1e9)
    state = bias.state
    innovation, S = evidence.z - H @ state.x, H @ state.P @ H.T + evidence.R
    assert bias.weigh(evidence).nis == pytest.approx(innovation @ np.linalg.solve(S, innovation))
    bias.update(evidence)
    gain = state.P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(bias.state.x, state.x + gain @ innovation)
    np.testing.assert_allclose(bias.state.P, state.P - gain @ S @ gain.T, atol=1e-18)


def test_a_part_of_the_bias_is_seen_alone() -> None:
    bias = start()
    along = np.array([0.6, 0.0, 0.8])
    H = np.zeros((1, OWN))
    H[:, BIAS] = along
    before = bias.state
    bias.update(Evidence("part", H @ before.x + 1e-3, H, np.array([[1e-12]]), GATES[1]))
    np.testing.assert_allclose(bias.state.bias - before.bias, 1e-3 * along, atol=1e-8)
    across = np.array([0.8, 0.0, -0.6])
    assert across @ bias.state.bias_cov @ across == pytest.approx(1e-6)
    assert along @ bias.state.bias_cov @ along < 1e-11


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


def test_where_a_thermometer_tells_of_warming_the_walk_is_not_widened_for_it() -> None:
    warming = BiasFilter(replace(start(temperature=25.0).state, powered=9.0))
    warming.predict(110.0, 25.0)
    np.testing.assert_allclose(np.diag(warming.state.bias_cov), 1e-6 + BiasKnobs().rate_random_walk ** 2 * 100)


@pytest.mark.parametrize("time", [10.0, 5.0, NAN])
def test_time_that_does_not_go_on_changes_nothing(time: float) -> None:
    bias = start()
    before = bias.state
    assert bias.predict(time, 30.0) is None
    np.testing.assert_array_equal(bias.state.P, before.P)
    assert bias.state.time == 10.0


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


@pytest.mark.parametrize("value", [0.0, -1e-8])
@pytest.mark.parametrize("soft", [False, True])
def test_a_measurement_without_uncertainty_is_refused(value: float, soft: bool) -> None:
    bias = start()
    assert not bias.update(seen(bias.state.bias, np.diag([1e-8, 1e-8, value]), soft=soft)).accepted


def test_the_gate_is_where_it_says() -> None:
    bias = start()
    edge = np.sqrt(GATES[3] * (1e-6 + 1e-8))
    inside, outside = (bias.state.bias + np.array([0.0, edge * part, 0.0]) for part in (0.999, 1.001))
    refused = bias.update(seen(outside, SMALL))
    assert not refused.accepted
    assert refused.reason == "outside the gate"
    assert refused.test_ratio > 1
    assert bias.update(seen(inside, SMALL)).accepted


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


def test_warming_adds_uncertainty_once() -> None:
    knobs = BiasKnobs(rate_random_walk=0.0, curvature=0.0)

    def std_k(bias: BiasFilter) -> float:
        return float(np.sqrt(bias.state.P[0, 0] - 1e-6)) / knobs.per_kelvin

    steady, flickering = (start(temperature=25.0, knobs=knobs) for _ in range(2))
    steady.predict(70.0, 30.0)
    for second in range(1, 60):
        flickering.predict(10.0 + second, 25.0 + 5.0 * (second % 2))
    assert std_k(steady) == pytest.approx(5.0)
    assert std_k(flickering) == pytest.approx(5.0), "back and forth adds nothing"
    flickering.predict(71.0, 33.0)
    assert std_k(flickering) == pytest.approx(8.0)


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


@pytest.mark.parametrize("steps", [10, 100, 3600])
def test_a_slope_is_given_way_by_the_kelvin_however_slowly_it_warms(steps: int) -> None:
    """By the step, 3600 of them left a twentieth of what ten did, and each jitter of the thermometer added to it."""
    bias = BiasFilter(begin(np.zeros(3), SMALL, 0.0, BiasKnobs(), temperature_c=25.0))
    learnt = bias.state
    learnt.P[SLOPE, SLOPE] = 0.0
    bias.restart(learnt)
    for i in range(1, steps + 1):
        if i == steps // 2:
            bias = BiasFilter(bias.state)  # a cut changes nothing
        bias.predict(3600.0 * i / steps, 25.0 + 10.0001 * i / steps)
    slope_std = np.sqrt(np.diag(bias.cov)[SLOPE])
    np.testing.assert_allclose(slope_std, np.sqrt(10) * BiasKnobs().curvature, rtol=0.05)
    before = bias.cov[SLOPE, SLOPE].copy()
    for i in range(1, 1001):
        bias.predict(3600.0 + i, 35.0 + 0.2 * (i % 2))
    np.testing.assert_array_equal(bias.cov[SLOPE, SLOPE], before)


def test_a_first_temperature_is_no_warming() -> None:
    bias = start()
    bias.predict(11.0, 40.0)
    np.testing.assert_allclose(bias.state.P[0, 0], 1e-6 + BiasKnobs().rate_random_walk ** 2)
    assert bias.state.temperature_c == 40.0
    # Nor is one that is not known for a while.
    bias.predict(12.0)
    assert bias.state.temperature_c == 40.0


def test_an_error_common_to_all_measurements_is_not_averaged_away() -> None:
    bias, common = start(), np.array([0.0, 4e-8, 0.0])
    for _ in range(1000):
        assert bias.update(seen(bias.state.bias, SMALL + np.diag(common), common)).accepted
    assert bias.state.P[0, 0] < 1e-10
    assert bias.state.P[1, 1] == pytest.approx(4e-8)


def test_doubt_widens_the_bias_alone() -> None:
    bias = start()
    before = bias.state
    bias.widen(2 * SMALL)
    bias.widen(SMALL)
    np.testing.assert_allclose(bias.state.bias_cov, before.bias_cov + 3 * SMALL)
    np.testing.assert_array_equal(bias.state.P[SLOPE, SLOPE], before.P[SLOPE, SLOPE])
    np.testing.assert_array_equal(bias.state.x, before.x)
    np.testing.assert_allclose(bias.widened, 3 * SMALL)  # type: ignore[arg-type]
    bias.predict(11.0)
    assert bias.widened is None


def test_saved_state_is_a_copy_and_goes_on_bit_for_bit() -> None:
    rng = np.random.default_rng(0)
    steps = [
        (10.0 + t, 25.0 + 0.1 * rng.normal(), [0.1, -0.2, 0.0] + 1e-3 * rng.normal(size=3), rng.uniform(0.5, 2.0))
        for t in range(1, 120)
    ]

    def run(bias: BiasFilter, part: slice) -> BiasFilter:
        for time, temperature, z, size in steps[part]:
            bias.predict(time, temperature)
            bias.update(seen(z, size * 1e-6 * np.eye(3)))
        return bias

    whole = run(start(temperature=25.0), slice(None)).state
    for cut in range(0, 119, 7):
        first = run(start(temperature=25.0), slice(cut))
        saved = first.state
        first.widen(SMALL)  # what happens to the old filter does not reach the copy
        run(first, slice(cut, None))
        resumed = run(BiasFilter(replace(saved)), slice(cut, None)).state
        for name in ("x", "P"):
            np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
        assert resumed.time == whole.time
        assert (resumed.temperature_c, resumed.powered) == (whole.temperature_c, whole.powered)


def test_a_law_takes_the_place_of_the_slope_for_what_waits_too() -> None:
    bias = start(temperature=20.0)
    bias.predict(11.0, 21.0)
    bias.wait()
    bias.predict(12.0, 22.0)
    bias.update(seen(np.array([0.1, -0.2, 0.0]), SMALL))
    none = np.zeros(3)
    bias.expect(TemperatureLaw(20.0, none, none, 1e-20 * np.tile(np.eye(2), (3, 1, 1))))
    bias.take_first(seen(np.array([0.1002, -0.2, 0.0]), SMALL))
    np.testing.assert_allclose(bias.x[SLOPE], none, atol=1e-12)
    assert np.linalg.eigvalsh(bias.cov).min() >= 0
