"""What a person is told while a scripted hand calibrates a simulated device."""

from dataclasses import replace
from math import degrees

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Piece, Turn
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, session
from bridge.wire.messages import State, Verdict
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.guide.guide import Guide
from estimator.guide.steps import Instruction, Picture, Step
from tests.conftest import Effort
from tests.estimator.calibration.sessions import in_poses
from tests.estimator.guide.random_hand import sequence
from tests.estimator.guide.scripted import BATCH, batches, follow, steps, turned
from tests.estimator.stream import NAME, calibration
from tests.sentences import codes, free

ONE_TURN = ["turn", "turning", "settle"]


def keys(told: list[Instruction]) -> set[str]:
    return {words.code for one in told for words in one.wrong}


def test_a_good_one_needs_no_click() -> None:
    told = follow(Guide(), DeviceSession(NAME), batches(turned(TurnPlan(2), TurnPlan(0, -360.0), TurnPlan(1))))
    assert steps(told) == ["warm", "place", *ONE_TURN, *ONE_TURN, *ONE_TURN, "done"]
    assert keys(told) == set()
    place = [one.ring for one in told if one.step is Step.PLACE]
    assert place == sorted(place)
    assert place[0] < 0.6
    # A turn's ring fills with it; axis and way are recognised long before its end.
    for axis, way, picture in ((2, 1, Picture.FLAT), (0, -1, Picture.ALONG), (1, 1, Picture.ACROSS)):
        turning = [one for one in told if one.step is Step.TURNING and one.head.key == "turning" and one.axis == axis]
        assert {one.picture for one in turning} == {picture}
        assert min(abs(degrees(one.angle)) for one in turning) < 60
        assert max(one.ring for one in turning) > 0.75  # as read: its scale is not known yet
        assert all(one.angle * way > 0 for one in turning)
    assert told[-1].done == (2, 0, 1)


def test_turns_that_do_not_fit_are_repeated() -> None:
    """The device is put down 3° off: seen only when all three turns are there. One axis is asked for again."""
    missed = SessionPlan(3.4, (TurnPlan(2), TurnPlan(0), TurnPlan(1)), (4.0, 5.0), 1.0, 2.0, 2.0)
    mended = session(np.random.default_rng(5), SessionPlan(3.4, (TurnPlan(0),), (4.0, 5.0)))
    device = DeviceSession(NAME)
    told = follow(Guide(), device, batches(calibration(seed=13, plan=missed, after=mended)))
    wrong = next(one for one in told if one.wrong)
    assert (wrong.step, wrong.axis, wrong.needed, wrong.done) == (Step.TURN, 0, (0,), (1, 2))
    assert [(one.code, one.params["axes"]) for one in wrong.wrong] == [(Code.TURNS_OPEN, "x")]
    assert steps(told) == ["warm", "place", *ONE_TURN, *ONE_TURN, *ONE_TURN, *ONE_TURN, "done"]
    assert device.calibration is not None
    assert device.calibration.verdict is Verdict.ACCEPTED


def test_a_method_by_movements_wants_sides_and_no_turns() -> None:
    of = in_poses(7, 14, after=4)
    knobs = SessionKnobs(method="transitions")
    device, guide = DeviceSession("chest", knobs), Guide(knobs.method, knobs.prior.noise_std)
    told = follow(guide, device, of.batches(range(BATCH, len(of), BATCH)))
    assert {one.step for one in told} == {Step.WARM, Step.PLACE, Step.POSE, Step.SETTLE, Step.DONE}
    poses = [one for one in told if one.step is Step.POSE]
    assert {one.picture for one in poses} == {Picture.POSE}
    seen = [len(one.sides or ()) for one in poses]
    assert seen == sorted(seen)
    assert seen[-1] >= 5
    assert keys(told) == set()
    assert told[-1].step is Step.DONE


def test_one_who_comes_in_the_middle_sees_the_step() -> None:
    device = DeviceSession(NAME)
    sent = batches(turned(TurnPlan(2), TurnPlan(0), TurnPlan(1)))
    half = len(sent) // 2
    follow(Guide(), device, sent[:half])
    told = follow(Guide(), device, sent[half:])
    assert told[0].done == (2,)
    assert told[-1].step is Step.DONE


def test_one_who_comes_in_the_middle_of_a_failed_turn_is_told_why() -> None:
    """Of the half turn only its end is seen, which could as well have laid the device on another face."""
    device = DeviceSession(NAME)
    sent = batches(turned(TurnPlan(2), TurnPlan(0, 180.0)))
    told = follow(Guide(), device, sent)
    failed = next(i for i, one in enumerate(told) if one.wrong)
    late = Guide()
    for batch in sent[failed - 46 : failed + 1]:
        late.take_samples(batch)
    late.take_status(device.status(1))
    assert codes(late.told().wrong) == codes(told[failed].wrong)
    assert Code.TURN_TOO_SHORT in codes(late.told().wrong)


def test_a_calibrated_device_is_idle_and_a_lost_one_away() -> None:
    device = DeviceSession(NAME)
    follow(Guide(), device, batches(turned(TurnPlan(2), TurnPlan(0), TurnPlan(1))))
    guide = Guide()
    assert guide.told().step is Step.AWAY
    guide.take_status(device.status(1))
    assert guide.told().step is Step.IDLE
    device.silence(free("no samples for 3 s"))
    guide.take_status(device.status(2))
    assert guide.told().step is Step.AWAY


def test_what_is_less_exact_is_said_to_be_so_and_why() -> None:
    device, guide = DeviceSession(NAME), Guide()
    told = follow(guide, device, batches(turned(TurnPlan(2), TurnPlan(0), TurnPlan(1))))
    assert (told[-1].picture, told[-1].wrong) == (Picture.WELL, ())
    jumped = replace(device.status(1), state=State.DEGRADED, reason=free("at rest it reads 1.20 °/s off"))
    for one, step in ((Guide(), Step.IDLE), (guide, Step.DONE)):
        one.take_status(jumped)
        said = one.told()
        assert (said.step, said.head.key, said.how, said.picture) == (step, "degraded", "degraded", Picture.EDGE)
        assert said.wrong == jumped.reason


def stood_on_its_side(last_deg: float) -> tuple[list[Piece], SessionPlan]:
    """Turns about the two level axes, the device stood on its side, and a turn about the axis that was upright."""
    plan = SessionPlan(3.4, (TurnPlan(0), TurnPlan(1)), (4.0, 5.0))
    onto_its_side = Turn(1.5, np.array([1.0, 0.0, 0.0]), np.pi / 2, np.array([[0.0, 1.5, 1.0]]))
    last = session(np.random.default_rng(6), SessionPlan(3.4, (TurnPlan(2, last_deg),), (4.0, 5.0)))
    return [onto_its_side, *last], plan


def test_where_turns_must_be_level_it_is_stood_on_its_side_for_the_third() -> None:
    after, plan = stood_on_its_side(360.0)
    knobs = SessionKnobs(horizontal_turns=True)
    device = DeviceSession(NAME, knobs)
    told = follow(Guide(horizontal=True), device, batches(calibration(seed=4, plan=plan, after=after)))
    asked = [one for one in told if one.step is Step.TURN]
    assert (asked[0].axis, asked[0].needed) == (0, (0, 1, 2)), "the upright axis comes last"
    assert any(one.step is Step.STAND and one.picture is Picture.POSE and one.axis == 2 for one in told)
    assert keys(told) == set(), "standing it on its side is no turn that went wrong"
    assert told[-1].step is Step.DONE
    last = [one for one in told if one.step is Step.TURNING and one.axis == 2]
    for one in (*last, told[-1]):  # however it lies now
        assert one.ways[:2] == (Picture.ALONG, Picture.ACROSS), "the turns that are done stay as they were made"
    assert device.calibration is not None
    assert Code.TURNS_ASSUMED not in codes(device.calibration.reason)


def test_a_level_turn_of_a_wrong_angle_is_measured_by_gravity() -> None:
    after, plan = stood_on_its_side(357.0)
    of = calibration(seed=4, plan=plan, after=after)
    device = DeviceSession(NAME, SessionKnobs(horizontal_turns=True))
    follow(Guide(horizontal=True), device, batches(of))
    assert device.calibration is not None
    np.testing.assert_allclose(np.diag(device.calibration.matrix), of.truth.k, atol=1e-3)


def test_a_turn_about_the_vertical_is_refused_where_turns_must_be_level() -> None:
    device = DeviceSession(NAME, SessionKnobs(horizontal_turns=True))
    told = follow(Guide(horizontal=True), device, batches(turned(TurnPlan(2), TurnPlan(0), TurnPlan(1))))
    assert Code.VERTICAL_TURN in keys(told)
    assert device.calibration is None


@pytest.mark.soak
def test_right_is_never_told_to_be_wrong_nor_wrong_to_be_right(effort: Effort) -> None:
    """Random sequences of good and bad movements, also on a device that lies on any face, either way along the edge."""
    first = effort.seed if effort.long else 0
    assert [words for seed in range(first, first + effort(6, 200)) for words in sequence(seed)] == []


def test_after_a_roll_that_left_it_on_its_side_it_goes_on_from_there() -> None:
    """A roll of 270°: the same roll is asked for again, as the device lies now; to lay it back is no fault either."""
    lay_back = Turn(1.5, np.array([1.0, 0.0, 0.0]), np.pi / 2, np.array([[0.0, 1.5, 1.0]]))
    after = [lay_back, *session(np.random.default_rng(6), SessionPlan(3.4, (TurnPlan(0), TurnPlan(1)), (4.0, 5.0)))]
    plan = SessionPlan(3.4, (TurnPlan(2), TurnPlan(0, 270.0)), (4.0, 5.0))
    told = follow(Guide(), DeviceSession(NAME), batches(calibration(seed=4, plan=plan, after=after)))
    failed = next(one for one in told if one.wrong)
    assert (failed.head.key, failed.axis, failed.done) == ("again_along", 0, (2,))
    assert [one.code for one in failed.wrong] == [Code.TURN_TOO_SHORT]
    laid = next(one for one in told if one.laid)
    assert (laid.head.key, laid.axis, laid.wrong) == ("turn_along", 0, ())
    assert told[-1].step is Step.DONE
