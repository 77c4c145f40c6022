"""The life of one device, fed as the service feeds it."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Quality, State, Verdict
from estimator.calibration.session import STALE_S
from estimator.config.device_settings import knobs_of
from estimator.device.session import DeviceSession
from estimator.noise.device_model import load_model
from tests.estimator.device.session.lives import state
from tests.estimator.stream import NAME, Stream, calibration, feed, info, rates
from tests.sentences import codes


def test_from_power_up_to_good(once: Stream) -> None:
    device = DeviceSession(NAME)
    device.info = info()
    seen: list[State] = []
    corrected = []
    for batch in once.batches():
        corrected += feed(device, [batch]).corrected
        if not seen or seen[-1] is not state(device):
            seen.append(state(device))
    assert seen == [State.WARMING, State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING, State.TRACKING]
    assert len(rates(corrected)) == len(once), "corrected from the first sample on"
    qualities = [b.quality for b in corrected]
    assert qualities[0] is Quality.NONE
    assert Quality.BIAS_ONLY in qualities
    assert qualities == sorted(qualities), "it only gets better"
    good = [b for b in corrected if b.quality is Quality.GOOD]
    assert good[0].device_time[0] < 31.0
    assert device.calibration is not None
    np.testing.assert_allclose(np.diag(device.calibration.matrix), once.truth.k, atol=2e-4)
    assert (device.calibration.model, device.calibration.firmware) == ("m", "1.0")
    error = rates(good).astype(float) - once.rate[-len(rates(good)) :]
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.06


@pytest.mark.parametrize("accel", [True, False])
@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
def test_any_rate_with_and_without_an_accelerometer(rate_hz: float, accel: bool) -> None:
    of = calibration(seed=2, rate_hz=rate_hz)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches(list(range(8, len(of), 8)), accel=accel))
    assert outcome.calibration is not None
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), of.truth.k, atol=3e-4)
    assert device.status(1).rate_hz == pytest.approx(rate_hz, rel=1e-3)


def test_the_words_say_what_is_missing() -> None:
    of = calibration(TurnPlan(1), TurnPlan(0, 180.0), seed=3)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches())
    assert state(device) is State.TURNING
    assert any("turn about y was accepted. Turns still needed: x, z." in words for words in outcome.said)
    assert Code.TURNS_NEEDED in codes(device.life.reason)
    assert device.status(1).axes_done == (1,)


def test_a_turn_that_is_too_old_is_not_waited_with() -> None:
    of = calibration(TurnPlan(0), seed=3, after=[Still(STALE_S + 5.0)])
    device = DeviceSession(NAME)
    feed(device, of.part(0, of.at(STALE_S)).batches())
    assert (device.learnt.turned, device.learnt.awaited) == ((0,), True)
    outcome = feed(device, of.part(of.at(STALE_S), len(of)).batches(first=of.at(STALE_S)))
    assert (device.learnt.turned, device.learnt.awaited) == ((), False)
    assert codes(device.life.reason) == [Code.TURN_TOO_OLD, Code.TURNS_NEEDED]
    assert outcome.said == [english(*device.life.reason)]


@pytest.mark.parametrize(("angle", "kind"), [(330.0, "mpu-6050"), (440.0, "icm-20948"), (366.0, "factory-calibrated")])
def test_a_turn_that_was_not_once_around_is_asked_for_again(angle: float, kind: str) -> None:
    """About the vertical nothing shows it but what is known of the gyro."""
    turns = TurnPlan(0), TurnPlan(1), TurnPlan(2, angle), TurnPlan(2)
    of = calibration(*turns, seed=3, spec=ImuSpec(scale=(1.0, 1.0)))
    device = DeviceSession(NAME, knobs_of(load_model(kind)))
    first, second = feed(device, of.batches()).calibrations
    assert first.verdict is Verdict.REPEAT
    assert first.reason == (Code.NOT_ONE_TURN(turns=f"z {angle:.0f}°", axes="z"),)
    assert second.verdict is Verdict.ACCEPTED
    np.testing.assert_allclose(np.diag(second.matrix), of.truth.k, atol=1e-3)


def test_by_how_much_its_bias_flickers_is_told_by_its_model_beside_how_well_its_mean_is_known() -> None:
    of, model = calibration(seed=4), load_model("generic")
    device, steady = (
        DeviceSession(NAME, knobs_of(each)) for each in (model, replace(model, bias_instability=np.zeros(3)))
    )
    found, known = (feed(each, of.batches()).corrected[-1] for each in (device, steady))
    assert found.quality is Quality.GOOD
    flicker = np.sqrt(np.log(1000) / np.pi) * model.bias_instability
    np.testing.assert_allclose(found.flicker_std, flicker * of.truth.k, rtol=1e-3)
    np.testing.assert_array_equal(found.bias_std, known.bias_std)
    np.testing.assert_allclose(
        found.rate_std**2 - known.rate_std**2, np.tile(found.flicker_std**2, (len(found), 1)), rtol=1e-3
    )
    status = device.status(1)
    assert status.bias_std == steady.status(1).bias_std, "as a person wants it: of the mean"
