"""Allan variance against allantools and NIST's table; the coefficients against simulated truth."""

import allantools
import numpy as np
import pytest
from scipy.signal import butter, lfilter

from estimator.noise.allan_fit import degrees_of_freedom, identify, octaves, overlapping
from tests.estimator.stillness.rest import Floats, at_rest


def nist_1000() -> Floats:
    """NIST SP 1065, section 12.4: a thousand numbers of a prime modulus generator."""
    numbers = [1234567890]
    while len(numbers) < 1000:
        numbers.append(16807 * numbers[-1] % 2147483647)
    return np.array(numbers) / 2147483647


def test_the_published_table() -> None:
    found = np.sqrt(overlapping(nist_1000(), [1, 10, 100]))
    assert found == pytest.approx([2.922319e-01, 9.159953e-02, 3.241343e-02], rel=1e-6)


@pytest.mark.parametrize(("n", "rate_hz"), [(1000, 1.0), (5001, 104.0)])
def test_the_same_as_allantools(n: int, rate_hz: float) -> None:
    rate = at_rest(1, n, rate_hz, 0.01, 3e-3) + 4.5
    factors = octaves(n)
    tau, deviation, _, _ = allantools.oadev(rate, rate=rate_hz, data_type="freq", taus=np.array(factors) / rate_hz)
    assert tau * rate_hz == pytest.approx(factors)
    assert np.sqrt(overlapping(rate, factors)) == pytest.approx(deviation, rel=1e-9)


@pytest.mark.parametrize(("column", "alpha"), [(0, 0), (1, -1), (2, -2)])
def test_degrees_of_freedom_are_those_of_allantools(column: int, alpha: int) -> None:
    factors = octaves(3000)[1:]  # its flicker at m = 1 lacks the square of SP 1065
    theirs = [allantools.edf_simple(3001, m, alpha) for m in factors]
    assert degrees_of_freedom(3000, factors)[:, column] == pytest.approx(theirs)


def test_coefficients_of_an_hour() -> None:
    noise = identify(at_rest(4, 36_000, 10.0, 0.01, 7e-4), 10.0)
    assert noise.arw.low < 0.01 < noise.arw.high
    assert noise.arw.value == pytest.approx(0.01, rel=0.02)
    assert noise.rrw.low < 7e-4 < noise.rrw.high
    assert noise.rrw.value == pytest.approx(7e-4, rel=0.3)
    assert not noise.bias_instability.seen
    assert noise.drift == 0
    assert noise.fitted_from == noise.tau[0]
    assert noise.misfit < 2
    assert np.all((noise.low < noise.deviation) & (noise.deviation < noise.high))
    assert noise.model(noise.tau)[:8] == pytest.approx(noise.deviation[:8], rel=0.1)


def test_flicker_is_told_from_the_others() -> None:
    rng = np.random.default_rng(8)
    n, rate_hz, bias_instability = 40_000, 10.0, 0.02
    frequency = np.fft.rfftfreq(2 * n, 1 / rate_hz)
    frequency[0] = frequency[1]
    shape = bias_instability * np.sqrt(rate_hz / (2 * np.pi * frequency))  # IEEE Std 952: S(f) = B²/(2π f)
    flicker = np.fft.irfft(np.fft.rfft(rng.normal(0, 1, 2 * n)) * shape)[:n]
    noise = identify(flicker + at_rest(9, n, rate_hz, 0.01, 0.0), rate_hz)
    assert noise.bias_instability.seen
    assert noise.bias_instability.value == pytest.approx(bias_instability, rel=0.1)
    assert not noise.rrw.seen


def test_a_minute_shows_only_the_angle_random_walk() -> None:
    noise = identify(at_rest(5, 6000, 100.0, 0.01, 7e-4), 100.0)
    assert noise.arw.value == pytest.approx(0.01, rel=0.05)
    assert not noise.rrw.seen
    assert not noise.bias_instability.seen
    assert noise.rrw.high > 7e-4


def test_a_filter_in_the_device_does_not_pass_for_less_noise() -> None:
    numerator, denominator = butter(2, 0.2)
    rate = lfilter(numerator, denominator, at_rest(6, 60_000, 100.0, 0.01, 0.0))
    noise = identify(rate, 100.0)
    assert noise.fitted_from > 0.1
    assert noise.deviation[0] < 0.5 * noise.model(noise.tau[:1])[0]
    assert noise.arw.value == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("correlated_s", [1.0, 3.0, 10.0, 30.0])
def test_a_bias_that_wanders_otherwise_than_modelled_leaves_the_white_noise_what_it_is(correlated_s: float) -> None:
    """Two decades of white noise were taken for a filter's work, and the walk for up to five times as much or not seen."""
    n, forgets = 360_000, float(np.exp(-0.01 / correlated_s))
    kicks = np.random.default_rng(3).normal(0.0, 0.007 * np.sqrt(1 - forgets**2), n)
    noise = identify(at_rest(4, n, 100.0, 0.005, 0.0) + lfilter([1.0], [1.0, -forgets], kicks), 100.0)
    assert noise.fitted_from == 0.01
    assert noise.arw.low < 0.005 < noise.arw.high < 0.0051
    assert noise.misfit > 2.0, "and it is said that the rest is no such bias"


def test_a_steady_drift_is_no_random_walk() -> None:
    rate = at_rest(7, 60_000, 100.0, 0.005, 0.0) + np.linspace(0, 0.3, 60_000)
    noise = identify(rate, 100.0)
    assert noise.drift == pytest.approx(0.3 / 600, rel=0.1)
    assert noise.arw.value == pytest.approx(0.005, rel=0.02)
    assert noise.rrw.value < 1e-3


def test_few_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="95 rates are given; at least 96 rates are needed"):
        identify(np.zeros(95), 10.0)


@pytest.mark.parametrize(
    "rate",
    [np.tile([0.0, 1.0], 500), np.linspace(0, 1, 1000), np.repeat([0.0, 1.0], 500), np.eye(1, 1000, 500)[0]],
    ids=["alternating", "ramp", "step", "spike"],
)
def test_strange_rates_give_numbers(rate: Floats) -> None:
    noise = identify(rate, 100.0)
    for found in (noise.arw, noise.bias_instability, noise.rrw):
        assert 0 <= found.low <= found.value <= found.high < np.inf
