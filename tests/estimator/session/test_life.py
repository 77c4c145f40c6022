"""The life of one device, fed as the service feeds it."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.imperfection import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.script import TurnPlan
from bridge.wire import codec, keys
from bridge.wire.messages import NO_REST_S, Quality, State, Verdict
from estimator import offline
from estimator.batch.capture import Capture
from estimator.batch.methods import METHODS
from estimator.batch.result import Result, nothing
from estimator.batch.session import STALE_S
from estimator.device_knobs import knobs_of
from estimator.noise_model import load_model
from estimator.session import DeviceSession
from tests.estimator.session.lives import state
from tests.estimator.stream import NAME, Stream, calibration, feed, info, rates
from tests.sentences import codes, free


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


def test_sequence_and_ticks_of_what_is_corrected_go_on_without_a_break(once: Stream) -> None:
    corrected = feed(DeviceSession(NAME), once.batches()).corrected
    numbers = np.concatenate([b.sequence + np.arange(len(b)) for b in corrected])
    np.testing.assert_array_equal(numbers, np.arange(len(once)))
    np.testing.assert_array_equal(np.concatenate([b.ticks for b in corrected]), once.ticks)
    assert all(codec.decode_corrected(keys.build("w", "corrected", device=NAME), codec.encode_corrected(b)).quality
               is b.quality for b in corrected)  # fmt: skip


@pytest.mark.parametrize("accel", [True, False])
@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
def test_any_rate_with_and_without_an_accelerometer(rate_hz: float, accel: bool) -> None:
    of = calibration(seed=2, rate_hz=rate_hz)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches(list(range(8, len(of), 8)), accel=accel))
    assert outcome.calibration is not None
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), of.truth.k, atol=3e-4)
    assert device.status(1).rate_hz == pytest.approx(rate_hz, rel=1e-3)


def test_status_can_be_published_at_any_time(once: Stream) -> None:
    device = DeviceSession(NAME)
    key = keys.build("w", "status", device=NAME)
    assert codec.decode_status(key, codec.encode_status(device.status(1))).state is State.UNKNOWN
    for batch in once.batches(list(range(50, len(once), 50))):
        feed(device, [batch])
        status = codec.decode_status(key, codec.encode_status(device.status(1)))
        assert status.samples_in == status.samples_out + sum(status.dropped.values())
        assert 0 <= status.progress <= 1
        assert status.evidence_age_s >= 0
        if device.life.state in {State.UNKNOWN, State.WARMING}:
            assert status.evidence_age_s == NO_REST_S
    assert 0 <= status.evidence_age_s < 60
    assert status.progress == 1
    assert status.axes_done == ()
    np.testing.assert_allclose(status.scale, once.truth.k, atol=2e-4)


@pytest.mark.parametrize(("rate_hz", "seldom"), [(4.0, True), (6.0, False)])
def test_samples_that_come_too_seldom_are_no_fault_of_who_holds_it(rate_hz: float, seldom: bool) -> None:
    of = calibration(seed=2, rate_hz=rate_hz)
    device = DeviceSession(NAME)
    device.info = replace(info(), rate_hz=rate_hz, measured_rate_hz=rate_hz)
    feed(device, of.batches())
    low = Code.RATE_TOO_LOW(rate_hz="4.0", least_hz="4")
    assert (device.status(1).reason == (low,)) is seldom
    assert (low in offline.calibrate(of.recording())[0].reason) is seldom


def test_the_words_say_what_is_missing() -> None:
    of = calibration(TurnPlan(1), TurnPlan(0, 180.0), seed=3)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches())
    assert state(device) is State.TURNING
    assert any("turn about y was taken. Turns still needed: x, z." in words for words in outcome.said)
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


def test_turns_that_are_to_be_repeated_are_not_said_to_be_too_old(monkeypatch: pytest.MonkeyPatch) -> None:
    def open_about_y(capture: Capture) -> Result:
        return nothing("closure", Verdict.REPEAT, free("the turn about y did not end where it began"), (1,))

    monkeypatch.setitem(METHODS, "closure", open_about_y)
    device = DeviceSession(NAME)
    outcome = feed(device, calibration(seed=4).batches())
    assert outcome.said[-2:] == [
        "TURNING -> TURNING: The turn about z was taken.",
        "TURNING -> TURNING: the turn about y did not end where it began",
    ]
    assert device.status(1).axes_done == (0, 2)


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


def test_a_calibration_that_fails_is_told_and_fits_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    from estimator.batch import closure

    def never(*_: object) -> None:
        raise closure.NotConverged(Code.TURNS_UNDETERMINED())

    monkeypatch.setattr(closure, "estimate", never)
    device = DeviceSession(NAME)
    outcome = feed(device, calibration(seed=4).batches())
    assert state(device) is State.TURNING
    assert device.calibration is None
    assert outcome.calibration is not None
    assert outcome.calibration.verdict is Verdict.REFUSED
    key = keys.build("w", "calibration", device=NAME)
    assert codec.decode_calibration(key, codec.encode_calibration(outcome.calibration)).parameters == ()
    assert not any(b.quality is Quality.GOOD for b in outcome.corrected)
