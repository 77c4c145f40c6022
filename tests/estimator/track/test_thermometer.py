"""What a thermometer says is neither its noise nor a leap that does not stay."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.track.bias_filter import SLOPE, BiasKnobs
from estimator.track.thermometer import Thermometer, ThermometerKnobs
from tests.estimator.track.worn import PLAIN, Worn, rest

KNOBS = ThermometerKnobs()


def test_before_any_reading_nothing_is_known() -> None:
    assert math.isnan(Thermometer().now)
    assert math.isnan(Thermometer().at(1.0))


def test_what_says_nothing_is_no_reading() -> None:
    """Who adopted a calibration before any came had none for the rest of the boot."""
    one = Thermometer()
    one.go_on_with(1.0, math.nan, 0.0)
    one.read(2.0, 25.0)
    one.read(3.0, math.nan)
    assert one.now == one.reading == one.at(9.0) == 25.0


def test_the_first_reading_is_believed_as_it_is() -> None:
    one = Thermometer()
    one.read(5.0, 31.25)
    assert one.now == one.at(3.0) == one.at(9.0) == 31.25


@pytest.mark.parametrize("step_s", [0.125, 1.0])
def test_noise_is_averaged_and_warmth_followed(step_s: float) -> None:
    rng, one, off = np.random.default_rng(1), Thermometer(), []
    for i in range(round(600 / step_s)):
        true = 25.0 + 0.01 * i * step_s
        one.read(i * step_s, true + 0.1 * rng.normal())
        off.append(one.now - true)
    late = np.array(off[len(off) // 10 :])
    assert late.std() < 0.1 / 3
    np.testing.assert_allclose(late.mean(), -0.01 * KNOBS.average_s, rtol=0.2)


def test_after_a_silence_a_reading_stands_for_itself() -> None:
    one = Thermometer()
    one.read(0.0, 25.0)
    one.read(3600.0, 26.5)
    assert one.now == pytest.approx(26.5)
    one.read(3660.0, 16.5)
    assert one.now == pytest.approx(16.5, abs=0.1), "in a minute it may have cooled, in a second it may not"


def test_what_it_said_a_while_ago() -> None:
    one = Thermometer()
    times, said = 2.0 + 1.3 * np.arange(20), []
    for time in times:
        one.read(time, 20.0 + 0.05 * time)
        said.append(one.now)
    for time in (0.0, 2.0, 3.0, 13.7, *times, times[-1] + 50.0):
        assert one.at(time) == pytest.approx(np.interp(time, times, said), rel=1e-12)


def test_what_is_not_told_any_more_is_not_known() -> None:
    """Taken for what it was it let the bias walk as one does at an even temperature, while the device cooled."""
    one = Thermometer()
    one.read(0.0, 30.0)
    assert one.at(one.knobs.stale_s) == 30.0
    assert np.isnan(one.at(one.knobs.stale_s + 1.0))


def test_a_leap_is_believed_when_it_stays_and_then_at_once() -> None:
    one = Thermometer()
    one.read(0.0, 25.0)
    for i in range(1, 10):
        one.read(float(i), 40.0)
        assert one.now == 25.0
    one.read(9.5, 25.0)
    assert one.now == 25.0, "it did not stay"
    for i in range(11):
        one.read(20.0 + i, 40.0)
    assert one.now == 40.0


def test_a_noisy_thermometer_teaches_nothing_of_warmth() -> None:
    """Taken for warmth, 0.1 K of noise at rest made the slope sure to be none."""
    of = rest(600.0, spec=replace(PLAIN, temperature_c=(25.0, 25.0)))
    noise = 0.1 * np.random.default_rng(2).normal(size=len(of))
    worn = Worn.new().lives(replace(of, temperature_c=of.temperature_c + noise), temperature=True)
    slope_std = np.sqrt(np.diag(worn.tracker.state.P)[SLOPE])
    assert (slope_std > 0.7 * BiasKnobs().per_kelvin).all()


def test_an_average_that_was_kept_goes_on() -> None:
    rng, whole, kept = np.random.default_rng(3), Thermometer(), Thermometer()
    celsius = 25.0 + 0.01 * np.arange(60) + 0.1 * rng.normal(size=60)
    for i, c in enumerate(celsius):
        whole.read(float(i), c)
        if i == 30:
            kept.go_on(30.0, whole.now)
        if i > 30:
            kept.read(float(i), c)
    assert kept.now == whole.now
    assert kept.reading == celsius[-1]
    kept.go_on(99.0, math.nan)
    assert kept.now == whole.now, "where none was known there is nothing to go on from"
