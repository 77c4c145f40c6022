"""What a thermometer says is neither its noise nor a leap that does not stay."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.tracking.bias_state import SLOPE, BiasKnobs
from estimator.tracking.thermometer import Thermometer, ThermometerKnobs
from tests.estimator.tracking.worn import PLAIN, Worn, rest

KNOBS = ThermometerKnobs()


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
