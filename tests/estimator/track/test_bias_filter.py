from dataclasses import replace

import numpy as np
import pytest

from estimator.track.bias_filter import BiasFilter, BiasKnobs, BiasState

SMALL = np.eye(3) * 1e-8


def start(var: float = 1e-6, temperature: float = float("nan")) -> BiasFilter:
    return BiasFilter(BiasState(np.array([0.1, -0.2, 0.0]), var * np.eye(3), 10.0, temperature))


def test_one_update_is_the_textbooks() -> None:
    bias = start(4e-6)
    z, R = np.array([0.101, -0.2, 0.002]), np.diag([1e-6, 4e-6, 16e-6])
    receipt = bias.update("zaru", z, R)
    gain = 4e-6 / (4e-6 + np.diag(R))
    np.testing.assert_allclose(bias.state.x, [0.1 + gain[0] * 0.001, -0.2, gain[2] * 0.002])
    np.testing.assert_allclose(np.diag(bias.state.P), (1 - gain) * 4e-6)
    np.testing.assert_allclose(receipt.innovation, [0.001, 0.0, 0.002])
    np.testing.assert_allclose(receipt.innovation_cov, 4e-6 * np.eye(3) + R)
    nis = 0.001**2 / 5e-6 + 0.002**2 / 20e-6
    assert receipt.test_ratio == pytest.approx(nis / bias.knobs.gate)
    assert receipt.accepted
    assert (receipt.kind, receipt.time) == ("zaru", 10.0)


def test_it_walks_with_time_however_often_it_is_asked() -> None:
    once, often = start(), start()
    once.predict(110.0)
    for time in np.linspace(10.0, 110.0, 501)[1:]:
        often.predict(float(time))
    np.testing.assert_allclose(np.diag(once.state.P), 1e-6 + BiasKnobs().rate_random_walk ** 2 * 100)
    np.testing.assert_allclose(often.state.P, once.state.P)


@pytest.mark.parametrize("time", [10.0, 5.0, float("nan")])
def test_time_that_does_not_go_on_changes_nothing(time: float) -> None:
    bias = start()
    bias.predict(time, 30.0)
    np.testing.assert_array_equal(bias.state.P, 1e-6 * np.eye(3))
    assert bias.state.time == 10.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_gets_in(bad: float) -> None:
    for place in range(3):
        bias = start()
        before = bias.state
        z = before.x.copy()
        z[place] = bad
        assert not bias.update("zaru", z, SMALL).accepted
        R = SMALL.copy()
        R[place, place] = bad
        assert not bias.update("zaru", before.x, R).accepted
        np.testing.assert_array_equal(bias.state.x, before.x)
        np.testing.assert_array_equal(bias.state.P, before.P)
    assert bias.update("zaru", before.x, SMALL).accepted


@pytest.mark.parametrize("value", [0.0, -1e-8])
def test_a_measurement_without_uncertainty_is_refused(value: float) -> None:
    bias = start()
    assert not bias.update("zaru", bias.state.x, np.diag([1e-8, 1e-8, value])).accepted


def test_the_gate_is_where_it_says() -> None:
    bias = start()
    edge = np.sqrt(bias.knobs.gate * (1e-6 + 1e-8))
    inside, outside = (bias.state.x + np.array([0.0, edge * part, 0.0]) for part in (0.999, 1.001))
    refused = bias.update("zaru", outside, SMALL)
    assert not refused.accepted
    assert refused.reason == "outside the gate"
    assert refused.test_ratio > 1
    assert bias.update("zaru", inside, SMALL).accepted


def test_gate_lets_one_good_measurement_in_a_million_out() -> None:
    from scipy.stats import chi2

    assert chi2.sf(BiasKnobs().gate, 3) == pytest.approx(1e-6, rel=0.01)


def test_warming_adds_uncertainty_once() -> None:
    def std_k(bias: BiasFilter) -> float:
        walk = BiasKnobs().rate_random_walk ** 2 * (bias.state.time - 10.0)
        return float(np.sqrt(bias.state.P[0, 0] - 1e-6 - walk)) / BiasKnobs().per_kelvin

    steady, flickering = start(temperature=25.0), start(temperature=25.0)
    steady.predict(70.0, 30.0)
    for second in range(1, 60):
        flickering.predict(10.0 + second, 25.0 + 5.0 * (second % 2))
    assert std_k(steady) == pytest.approx(5.0)
    assert std_k(flickering) == pytest.approx(5.0), "back and forth adds nothing"
    flickering.predict(71.0, 33.0)
    assert std_k(flickering) == pytest.approx(8.0)


def test_evidence_makes_the_present_temperature_the_reference() -> None:
    bias = start(temperature=25.0)
    bias.predict(11.0, 30.0)
    assert bias.update("zaru", bias.state.x, SMALL).accepted
    before = bias.state
    assert (before.reference_c, before.farthest_k) == (30.0, 0.0)
    bias.predict(12.0, 30.0)
    np.testing.assert_allclose(bias.state.P, before.P + BiasKnobs().rate_random_walk ** 2 * np.eye(3))
    # A refusal is no evidence.
    bias.predict(13.0, 40.0)
    bias.update("zaru", bias.state.x + 1.0, SMALL)
    assert bias.state.reference_c == 30.0


def test_a_first_temperature_is_no_warming() -> None:
    bias = start()
    bias.predict(11.0, 40.0)
    np.testing.assert_allclose(bias.state.P[0, 0], 1e-6 + BiasKnobs().rate_random_walk ** 2)


def test_an_error_common_to_all_measurements_is_not_averaged_away() -> None:
    bias, common = start(), np.array([0.0, 4e-8, 0.0])
    for _ in range(1000):
        assert bias.update("zaru", bias.state.x, SMALL + np.diag(common), common).accepted
    assert bias.state.P[0, 0] < 1e-10
    assert bias.state.P[1, 1] == pytest.approx(4e-8)


def test_restart_believes_only_the_new() -> None:
    bias = start()
    bias.restart(np.full(3, 0.5), SMALL)
    np.testing.assert_array_equal(bias.state.x, np.full(3, 0.5))
    np.testing.assert_array_equal(bias.state.P, SMALL)


def test_saved_state_is_a_copy_and_goes_on_bit_for_bit() -> None:
    rng = np.random.default_rng(0)
    steps = [
        (10.0 + t, 25.0 + 0.1 * rng.normal(), [0.1, -0.2, 0.0] + 1e-3 * rng.normal(size=3), rng.uniform(0.5, 2.0))
        for t in range(1, 120)
    ]

    def run(bias: BiasFilter, part: slice) -> BiasFilter:
        for time, temperature, z, size in steps[part]:
            bias.predict(time, temperature)
            bias.update("zaru", z, size * 1e-6 * np.eye(3))
        return bias

    whole = run(start(temperature=25.0), slice(None)).state
    for cut in range(0, 119, 7):
        first = run(start(temperature=25.0), slice(cut))
        saved = first.state
        first.restart(np.zeros(3), SMALL)  # what happens to the old filter does not reach the copy
        resumed = run(BiasFilter(replace(saved)), slice(cut, None)).state
        for name in ("x", "P"):
            np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
        assert resumed.time == whole.time
        assert (resumed.temperature_c, resumed.reference_c) == (whole.temperature_c, whole.reference_c)
