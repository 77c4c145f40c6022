"""Calibrations by transitions over many sessions, good and bad: what is accepted is right within what it says of itself."""

from collections.abc import Callable

import numpy as np
import pytest

from bridge.recording import Recording
from bridge.sim.calibration_session import Session, simulate_session
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Verdict
from estimator.calibration.result import Result
from estimator.offline import recordings

Plan = Callable[[np.random.Generator], tuple[TurnPlan, ...]]


def calibrated(of: Session, keep: slice = slice(None)) -> Result:
    recording = Recording(of.time_s[keep], of.gyro[keep], of.accel[keep], None, of.rate_hz, "")
    return recordings.calibrate(recording, "transitions")[0]


def wrong(result: Result, of: Session) -> bool:
    if result.verdict is not Verdict.ACCEPTED:
        return False
    error = np.abs(result.scale - of.truth.k)
    return bool((error > np.maximum(5 * np.sqrt(np.diag(result.covariance)[3:6]), 0.005)).any())


def three_turns(rng: np.random.Generator) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(axis), 360.0 * rng.choice([-1, 1])) for axis in rng.permutation(3))


def one_angle(rng: np.random.Generator) -> tuple[TurnPlan, ...]:
    angle = float(rng.choice([180.0, 270.0, 330.0, 345.0, 390.0, 540.0, 720.0]) * rng.choice([-1, 1]))
    return *three_turns(rng), TurnPlan(int(rng.integers(0, 2)), angle)


def swings(rng: np.random.Generator) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(rng.integers(0, 3)), float(rng.uniform(100, 500)), swing=True) for _ in range(8))


def quarters(rng: np.random.Generator) -> tuple[TurnPlan, ...]:
    return tuple(TurnPlan(int(rng.integers(0, 3)), 90.0 * int(rng.choice([-2, -1, 1, 2]))) for _ in range(10))


@pytest.mark.parametrize(("plan", "least"), [(three_turns, 14), (one_angle, 14), (swings, 14), (quarters, 5)])
def test_whatever_was_done_what_is_accepted_is_right(plan: Plan, least: int) -> None:
    """Ten random quarter turns may leave an axis that was never turned while level: then it is asked for."""
    accepted = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        of = simulate_session(
            seed,
            turns=plan(rng),
            rests_s=3.2,
            wobble_deg=2.0,
            replacement_deg=0.2,
            spec=ImuSpec(scale=(0.85, 1.15), misalignment_deg=0.5, accel_bias=0.2),
        )
        result = calibrated(of)
        assert not wrong(result, of), (seed, result.reason, result.scale - of.truth.k)
        accepted += result.verdict is Verdict.ACCEPTED
    assert accepted >= least


@pytest.mark.parametrize("seed", range(40))
def test_a_rest_with_a_rate_in_it_or_a_bias_that_jumps_does_no_harm(seed: int) -> None:
    """A slow movement taken for a rest, for every rest and either sign; or a bias that jumps within a turn."""
    rng = np.random.default_rng(seed)
    of = simulate_session(seed, spec=ImuSpec(scale=(0.9, 1.1), bias_limit_dps=2.0))
    spoilt = slice(*of.stages[rng.integers(0, len(of.stages))])
    if seed % 2:
        spoilt = slice(spoilt.start + 50, None)
    of.gyro[spoilt] += np.radians(rng.uniform(0.3, 5.0)) * rng.choice([-1, 1], 3)
    result = calibrated(of)
    assert not wrong(result, of), (result.reason, result.scale - of.truth.k)
