from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import SessionPlan
from estimator.calibration import closure, turn360
from estimator.calibration.capture import Capture, Floats
from estimator.calibration.closure import ClosureKnobs
from estimator.calibration.methods import METHODS
from estimator.calibration.replacement_error import Replacement
from estimator.calibration.session_events import TurnFound
from tests.estimator.calibration.sessions import progress
from tests.estimator.calibration.slow_closure import slow_closure
from tests.estimator.stream import Stream, calibration

#: the simulator's hand and bias where a test says no other
EXACT = ClosureKnobs(Replacement(1e-9, 1e-9), misalignment_std=0.0, rate_random_walk=0.0)


def capture(of: Stream, *, accel: bool = False) -> Capture:
    found = [p.turn for p in progress(of, accel=accel) if isinstance(p, TurnFound)]
    x, y, z = sorted(found, key=lambda turn: turn.axis)
    return Capture(found[0].before, (x, y, z), (*(turn.before for turn in found), found[-1].after))


def apart(found: Capture) -> Capture:
    """The same with no sample in a rest and in a turn."""
    turns = [replace(t, samples=t.samples.between(t.before.end + 1e-6, t.after.start - 1e-6)) for t in found.turns]
    return replace(found, turns=(turns[0], turns[1], turns[2]))


def std_of(found: closure.Closure) -> Floats:
    return np.asarray(np.sqrt(np.diag(found.covariance)))


@pytest.mark.parametrize("plan", [SessionPlan(), SessionPlan(wobble_deg=3.0, tilt_deg=5.0, replacement_deg=0.2)])
def test_it_agrees_with_the_slow_one(plan: SessionPlan) -> None:
    found = apart(capture(calibration(seed=30, plan=plan, rate_hz=52.0)))
    placed = Replacement(np.radians(0.2 if plan.replacement_deg else 1e-6))
    knobs = replace(EXACT, replacement=placed, honest_p=0.0)
    theta, covariance = slow_closure(found, placed.std)
    ours = closure.estimate(found, knobs)
    np.testing.assert_allclose(np.concatenate([ours.bias, ours.k]), theta, atol=2e-3 * std_of(ours).min())
    np.testing.assert_allclose(ours.covariance, covariance, atol=2e-3 * covariance.max(), rtol=5e-3)


def test_without_noise_any_path_gives_the_truth() -> None:
    of = calibration(seed=32, spec=ImuSpec(noise_dps=0.0), plan=SessionPlan(wobble_deg=10.0, tilt_deg=8.0))
    found = closure.estimate(capture(of), EXACT)
    np.testing.assert_allclose(found.k, of.truth.k, atol=1e-8)
    np.testing.assert_allclose(found.bias, of.bias[0], atol=1e-10)
    assert np.abs(turn360.estimate(capture(of)).k - of.truth.k).max() > 1e-3, "the paper's criterion needs a fixed axis"


def test_gravity_measures_the_tilt_that_the_hand_left() -> None:
    """A turn that ends 1.5° off is no error where it is seen, and is one where it is not."""
    of = calibration(seed=35, plan=SessionPlan(replacement_deg=0.9))
    blind = METHODS["closure"](capture(of))
    assert np.all(np.abs(blind.scale - of.truth.k) < 3 * blind.scale_std)
    assert blind.scale_std.max() > 1e-3
    blind_error, seen_error = (
        closure.estimate(capture(of, accel=accel)).k[:2] - of.truth.k[:2] for accel in (False, True)
    )
    assert np.abs(seen_error).max() < 4e-4
    assert np.abs(blind_error).max() > 2 * np.abs(seen_error).max()


def test_a_turn_about_the_vertical_is_as_sure_as_the_hand_puts_it_back() -> None:
    knobs = replace(EXACT, replacement=Replacement(np.radians(0.3), np.radians(0.1)))
    std = std_of(closure.estimate(capture(calibration(seed=36), accel=True), knobs))[3:]
    assert std[2] == pytest.approx(np.radians(0.3) / (2 * np.pi), rel=0.2)
    assert std[:2] == pytest.approx(np.radians(0.1) / (2 * np.pi), rel=0.3)


@pytest.mark.parametrize("accel", [False, True])
@pytest.mark.parametrize("missed_deg", [0.1, 0.5])
def test_how_well_the_hand_puts_it_back_is_estimated(missed_deg: float, accel: bool) -> None:
    plan = SessionPlan(replacement_deg=missed_deg)
    found = [closure.estimate(capture(calibration(seed=seed, plan=plan), accel=accel)) for seed in range(300, 312)]
    rms = np.degrees(np.sqrt(np.mean([one.replacement.std**2 for one in found])))
    assert missed_deg / 1.5 < rms < 2 * missed_deg
    assert all(np.degrees(one.replacement.tilt_std) < 0.1 for one in found), "gravity sees the tilt as it is"


def test_a_bias_that_moves_is_followed_from_rest_to_rest() -> None:
    of = calibration(seed=37)
    of.gyro[:] += np.radians(0.02) * ((of.time - of.time[-1]) / 10)[:, None]
    still, moving = (closure.estimate(capture(of), replace(EXACT, rate_random_walk=np.radians(q))) for q in (0, 5e-3))
    end = of.bias[-1] - np.radians(0.003)
    assert np.all(np.abs(moving.bias - end) < 4 * std_of(moving)[:3])
    assert still.chi2 > 10 * still.dof
    assert moving.chi2 < 2 * moving.dof
    assert np.abs(moving.k - of.truth.k).max() < np.abs(still.k - of.truth.k).max()
    middles = [np.radians(0.02) * ((t.before.end + t.after.start) / 2 - of.time[-1]) / 10 for t in capture(of).turns]
    np.testing.assert_allclose(moving.turn_bias, of.bias[0] + np.array(middles)[:, None], atol=np.radians(0.01))


@pytest.mark.parametrize("rate_hz", [26.0, 40.0])
def test_a_slow_rate_needs_the_coning_correction(rate_hz: float) -> None:
    """Readings are means over long intervals in which the hand's axis moves."""
    fine, spec = 16, ImuSpec(noise_dps=0.0)
    of = calibration(seed=41, spec=spec, rate_hz=fine * rate_hz, plan=SessionPlan(wobble_deg=10.0, turn_s=(3.0, 3.5)))
    n = len(of) // fine
    averaged = of.only(np.arange(1, n + 1) * fine - 1)
    averaged.gyro[:] = of.gyro[: n * fine].reshape(n, fine, 3).mean(axis=1)
    plain, coned = (
        np.abs(closure.estimate(capture(averaged), replace(EXACT, coning_below_hz=hz)).k - of.truth.k).max()
        for hz in (0.0, 50.0)
    )
    assert plain > 1e-5
    assert coned < plain / 10


def test_axes_that_are_not_orthogonal_make_it_less_sure_where_turns_tilt() -> None:
    straight, tilted = (
        capture(calibration(seed=44, plan=SessionPlan(tilt_deg=tilt), spec=ImuSpec(misalignment_deg=0.6)))
        for tilt in (0.0, 8.0)
    )
    told = replace(EXACT, misalignment_std=0.006)
    assert std_of(closure.estimate(straight, told))[3:].max() < 1.5e-4
    assert std_of(closure.estimate(tilted, told))[3:].max() > 5e-4
