from dataclasses import replace

import numpy as np

from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.wire.messages import Verdict
from estimator.calibration.servomotor import by_servomotor
from tests.estimator.calibration.machines import SERVO_DPS, on_a_servo, samples, turned
from tests.sentences import codes

RATE = tuple(np.radians(SERVO_DPS))


def test_an_accelerometer_has_no_say_however_far_off_it_is() -> None:
    of = on_a_servo(2)
    result = by_servomotor(samples(of), RATE)
    for accel in (None, of.accel + np.array([1.5, -0.4, -1.8]), np.zeros_like(of.accel)):
        other = by_servomotor(replace(samples(of), accel=accel), RATE)
        np.testing.assert_array_equal(other.covariance, result.covariance)
        np.testing.assert_array_equal(other.scale, result.scale)


def test_what_it_needs_is_said() -> None:
    of = samples(on_a_servo(3))
    assert Code.SERVO_RATES in codes(by_servomotor(of, (0.5, 1.0)).reason)
    nothing = by_servomotor(of.between(0.0, 1.0), RATE)
    assert (nothing.verdict, nothing.repeat) == (Verdict.REPEAT, (0, 1, 2))
    assert Code.SERVO_NO_REST in codes(nothing.reason)


def test_spins_that_contradict_one_rate_are_refused() -> None:
    result = by_servomotor(samples(turned(np.eye(3), (*SERVO_DPS, 32.0), 5, ImuSpec())), RATE)
    assert result.verdict is Verdict.REFUSED
    assert Code.SERVO_MISFIT in codes(result.reason)
