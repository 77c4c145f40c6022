"""Are calibrations on a turntable and a servo as sure as they say? A few recordings of a simulator that shares no code."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import Verdict
from estimator.calibration.bias_wander import WanderKnobs
from estimator.calibration.capture import Samples
from estimator.calibration.methods import BY_RATES
from estimator.calibration.result import Result
from estimator.noise.device_model import GENERIC, load_model
from tests.sim.machine_witness import Plan, Read, Unit, recorded

MEMS = Unit(misalignment=0.5)
SERVO, TABLE = (25.42, -25.42), (30.0, -30.0, 60.0, -60.0, 90.0, -90.0)
ON_SERVO, ON_TABLE = Plan(np.eye(3), SERVO), Plan(np.eye(3), TABLE, spin_s=23.6, rest_s=8.0)
BRIEF, OFFSET = replace(ON_TABLE, spin_s=5.0, rest_s=2.5), replace(MEMS, offset=90.0)


def askew(seed: int) -> Plan:
    """Each mounting tilted by some 15°."""
    off = np.eye(3) + 0.2 * np.random.default_rng((5, seed)).normal(size=(3, 3))
    return replace(ON_SERVO, up=off / np.linalg.norm(off, axis=1)[:, None])


def calibrated(plan: Plan, unit: Unit, seed: int, told: tuple[float, ...] = ()) -> tuple[Result, Read]:
    """The result with the rates that are told, °/s; by default those of a servo or table as they are."""
    read = recorded(plan, unit, seed)
    samples = Samples(read.time, read.gyro, read.accel, np.zeros(len(read.time), bool))
    servo = len(plan.rates) < 4
    told = told or (SERVO if servo else TABLE)[::2]
    return BY_RATES["servomotor" if servo else "turntable"](samples, tuple(np.radians(told)), WanderKnobs()), read


@pytest.mark.parametrize(
    ("plan", "unit", "runs"),
    [
        (ON_SERVO, OFFSET, 24),
        (askew, replace(OFFSET, misalignment=0.573), 24),
        (ON_SERVO, replace(OFFSET, drift=0.1 / 60), 16),
        (ON_TABLE, MEMS, 8),
        (BRIEF, MEMS, 16),
        (ON_TABLE, replace(MEMS, flicker=0.03), 4),
        (replace(ON_TABLE, rates=(*TABLE, 45.0, -45.0, 5.0, -5.0)), MEMS, 3),
    ],
    ids=["servo", "servo askew", "servo warming", "table", "table 200 s", "table flicker", "table also other rates"],
)
def test_what_is_good_is_accepted_and_as_sure_as_it_says(plan: Plan, unit: Unit, runs: int) -> None:
    found = [calibrated(plan(seed) if callable(plan) else plan, unit, seed) for seed in range(runs)]
    assert all(result.verdict is Verdict.ACCEPTED for result, _ in found), [result.reason for result, _ in found]
    nees = list[float]()
    for result, read in found:
        error, cov = result.scale - read.k, result.covariance[3:6, 3:6]
        assert (np.abs(error) <= np.maximum(0.01 * read.k, 4 * np.sqrt(np.diag(cov)))).all()
        nees.append(float(error @ np.linalg.solve(cov, error)) / 3)
    assert 0.25 < np.mean(nees) < 2.0


@pytest.mark.parametrize(
    ("plan", "unit", "told"),
    [
        (replace(ON_SERVO, rates=(*SERVO, 32.0)), OFFSET, SERVO[:1]),
        (ON_SERVO, OFFSET, (50.84,)),
        (BRIEF, MEMS, (31.0, 57.0, 90.0)),
        (BRIEF, MEMS, (10.0, 20.0, 30.0)),
        (BRIEF, MEMS, (30.0, 60.0, 100.0)),
        (BRIEF, MEMS, (30.0, 60.3, 90.0)),
        (BRIEF, MEMS, (30.0, 45.0, 90.0)),
    ],
)
def test_a_wrong_rate_is_not_accepted(plan: Plan, unit: Unit, told: tuple[float, ...]) -> None:
    assert not any(calibrated(plan, unit, seed, told)[0].verdict is Verdict.ACCEPTED for seed in range(4))


def test_a_bias_of_which_nothing_is_told_wanders_as_that_of_the_generic_model() -> None:
    knobs, model = WanderKnobs(), load_model(GENERIC)
    np.testing.assert_allclose(model.bias_instability, knobs.bias_instability)
    np.testing.assert_allclose(model.rrw, knobs.rate_random_walk)
