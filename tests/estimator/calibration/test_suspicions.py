"""What speaks against a calibration although its turns close: axes, units, rates, pauses, a rest that is none."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.recording import Recording
from bridge.sim.calibration_session import Session, simulate_session
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Verdict
from estimator.calibration.axis_alignment import MAPPINGS, foreign_axes, in_words
from estimator.calibration.result import Result
from estimator.offline import recordings
from tests.estimator.calibration.sessions import capture as captured
from tests.estimator.stream import Floats, calibration
from tests.sentences import codes


def calibrate(of: Session, gyro: Floats | None = None, *, accel: bool = True, rate: float = 1.0) -> Result:
    time = of.time_s / rate
    recording = Recording(
        time, of.gyro if gyro is None else gyro, of.accel if accel else None, None, of.rate_hz * rate, "session"
    )
    return recordings.calibrate(recording)[0]


@pytest.mark.parametrize("number", range(len(MAPPINGS)))
def test_every_swap_and_mirror_of_axes_is_named(number: int) -> None:
    of = simulate_session(20 + number, wobble_deg=2.0)
    result = calibrate(of, of.gyro @ MAPPINGS[number].T)
    if number == 0:
        assert result.verdict is Verdict.ACCEPTED, result.reason
    else:
        assert result.verdict is Verdict.REFUSED
        assert result.reason == (Code.AXES_DIFFER(mapping=in_words(MAPPINGS[number].T)),)


def test_of_a_movement_that_no_accelerometer_saw_axes_are_not_judged() -> None:
    turn = captured(calibration(seed=3)).turns[0]
    unseen = replace(turn.samples, accel=None)
    mirrored = replace(turn.samples, gyro=turn.samples.gyro @ MAPPINGS[-1].T)
    assert foreign_axes([(turn.before, unseen), (replace(turn.before, accel=None), mirrored)], np.eye(3)) is None


@pytest.mark.data
@pytest.mark.parametrize("number", [1, 7, 20, 47])
def test_a_mirrored_real_gyro_is_named(number: int, shared_data: object) -> None:
    with np.load(f"{shared_data}/imucal/ferraris_session.npz") as file:
        gyro, accel, rate_hz = file["gyro_rad_s"], file["accel_m_s2"], float(file["rate_hz"])
    time = np.arange(len(gyro)) / rate_hz
    result, _ = recordings.calibrate(Recording(time, gyro @ MAPPINGS[number].T, accel, None, rate_hz, "mirrored"))
    assert result.verdict is Verdict.REFUSED
    assert result.reason == (Code.AXES_DIFFER(mapping=in_words(MAPPINGS[number].T)),)


@pytest.mark.parametrize("accel", [True, False])
def test_degrees_for_radians_and_back_are_named(accel: bool) -> None:
    of = simulate_session(3)
    assert Code.READINGS_IN_DEGREES in codes(calibrate(of, np.degrees(of.gyro), accel=accel).reason)
    assert Code.READINGS_IN_RADIANS in codes(calibrate(of, np.radians(of.gyro), accel=accel).reason)


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_a_sample_rate_off_by_two_is_named(rate: float) -> None:
    result = calibrate(simulate_session(3, rests_s=6.0), accel=False, rate=rate)
    assert result.verdict is not Verdict.ACCEPTED
    assert Code.RATE_OFF_BY_TWO in codes(result.reason)


@pytest.mark.parametrize("factor", [1.147, 1.170])
def test_the_known_library_error_is_named(factor: float) -> None:
    of = simulate_session(3)
    result = calibrate(of, (of.gyro - of.bias) * of.truth.k / factor + of.bias)
    assert result.verdict is Verdict.ACCEPTED
    assert str(factor) in english(*result.reason)


def test_a_rest_that_is_too_short_is_named() -> None:
    result = calibrate(simulate_session(3, rests_s=(3.2, 1.5, 1.5, 3.2)))
    assert result.verdict is not Verdict.ACCEPTED
    assert Code.PAUSED in codes(result.reason)


def test_rests_in_a_hand_make_the_scale_as_unsure_as_it_is() -> None:
    """A hand that sways by half a degree a second is refused, or accepted for what it is worth."""
    accepted = []
    for seed in range(12):
        of = simulate_session(seed)
        swaying = np.radians(0.5) * np.sin(np.pi * of.time_s)[:, None]
        result = calibrate(of, of.gyro + swaying, accel=False)
        if result.verdict is Verdict.ACCEPTED:
            accepted.append(np.abs(result.scale - of.truth.k) / result.scale_std)
        else:
            assert Code.RESTLESS in codes(result.reason) or Code.TURN_BIAS_MOVED in codes(result.reason)
    assert len(accepted) > 3
    assert np.max(accepted) < 4


@pytest.mark.parametrize(
    ("turns", "words"),
    [
        ((TurnPlan(0), TurnPlan(1, 720.0), TurnPlan(2)), "more than one full turn"),
        ((TurnPlan(0), TurnPlan(1, 200.0), TurnPlan(2)), "not a full turn"),
    ],
)
def test_incomplete_and_double_turns_are_named(turns: tuple[TurnPlan, ...], words: str) -> None:
    result = calibrate(simulate_session(3, turns=turns))
    assert result.verdict is Verdict.REPEAT
    assert words in english(*result.reason)
    assert result.repeat == (1,)


def test_never_still_and_never_moved_are_told_apart() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(3000) / 104
    moving = np.radians(40) * rng.normal(size=(3000, 3))
    still = np.radians(0.03) * rng.normal(size=(3000, 3))
    assert Code.NEVER_STILL in codes(recordings.calibrate(Recording(time, moving, None, None, 104.0, "m"))[0].reason)
    assert Code.NEVER_MOVED in codes(recordings.calibrate(Recording(time, still, None, None, 104.0, "s"))[0].reason)
