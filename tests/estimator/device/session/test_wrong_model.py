"""Devices that are not of the model their ward's file names: the reason stays, and the setting is named once."""

import numpy as np

from bridge.reasons.codes import Code
from bridge.sim.motion import Still, Turn
from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import State, Status
from estimator.config.device_settings import Treatment
from estimator.device.session import DeviceSession
from estimator.guide.guide import Guide
from estimator.overview.summary import summarise
from tests.estimator.guide.scripted import batches, follow, turned
from tests.estimator.stream import NAME, calibration


def refused(seed: int) -> tuple[Status, list[str]]:
    """Status of a device that is several percent off, turned well under a model of one percent, and what the guide tells."""
    knobs = Treatment(model="factory-calibrated").of(NAME)
    nudge = Turn(1.0, np.array([1.0, 0.0, 0.0]), 0.2, np.array([[0.0, 1.0, 1.0]]))
    device, plan = DeviceSession(NAME, knobs), (TurnPlan(2), TurnPlan(0), TurnPlan(1))
    stream = calibration(*plan, seed=seed, after=[nudge, Still(4.0)])
    told = follow(Guide(knobs.method, knobs.prior.noise_std), device, batches(stream))
    assert device.life.state is State.TURNING
    return device.status(1), [one.code for one in told[-1].wrong]


def test_the_reason_outlives_the_next_movement() -> None:
    status, told = refused(3)
    assert status.reason[0].code == Code.NUDGE
    assert Code.NOT_ONE_TURN in [one.code for one in status.reason]
    assert Code.NOT_ONE_TURN in told


def test_several_devices_refused_alike_are_said_once_with_the_setting() -> None:
    status, _ = refused(3)
    seen = summarise("w", {"a": status, "b": status}, {}, ["b"], ["e"])
    assert seen.troubles == (Code.SETTING_DOUBTED(devices=2, names="a, b", setting="model"),)
    assert summarise("w", {"a": status}, {}, ["b"], ["e"]).troubles == (), "of one alone, the turns may be at fault"


def test_a_turn_taken_after_it_is_no_fault() -> None:
    knobs = Treatment(model="factory-calibrated").of(NAME)
    plan = turned(TurnPlan(2), TurnPlan(0), TurnPlan(1), TurnPlan(2), seed=3)
    told = follow(Guide(knobs.method, knobs.prior.noise_std), device := DeviceSession(NAME, knobs), batches(plan))
    reasons = [one.code for one in device.life.reason]
    assert reasons == [Code.TURN_TAKEN, Code.TURNS_NEEDED, Code.NOT_ONE_TURN]
    assert told[-1].wrong == ()
