"""A device that is silent for a while, then heard again in another pose: nothing breaks, and it can be calibrated."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.reasons.codes import Code
from bridge.recording import Recording
from bridge.sim.script import TurnPlan
from bridge.sim.session import simulate_session
from bridge.wire.messages import Quality, SampleBatch, State, Verdict
from estimator import offline
from estimator.session import DeviceSession
from estimator.track.bias_filter import BiasKnobs
from tests.sentences import codes


@pytest.mark.parametrize("hole_s", [1.0, 60.0, 119.0, 121.0, 3600.0])
def test_a_hole_of_any_length_in_a_rest_harms_nothing(hole_s: float) -> None:
    session = simulate_session(5)
    device = DeviceSession("chest")
    device.begin_boot(1, 0.0, None)
    rest = int(6.0 * session.rate_hz)
    ticks = np.arange(1, rest + 1) * 9615
    still = np.tile(session.gyro[:1], (rest, 1)) + 1e-4 * np.random.default_rng(1).normal(size=(rest, 3))
    later = ticks[-1] + int(hole_s * 1e6) + session.ticks
    outcomes = [
        device.handle(raw(still, ticks, 0)),
        *(device.handle(raw(session.gyro[i : i + 5], later[i : i + 5], rest + i)) for i in range(0, len(later), 5)),
    ]
    calibrations = [made for outcome in outcomes for made in outcome.calibrations]
    assert [c.verdict for c in calibrations] == [Verdict.ACCEPTED]
    assert np.diag(calibrations[0].matrix) == pytest.approx(session.truth.k, abs=2e-3)


def raw(gyro: NDArray[np.float64], ticks: NDArray[np.int64], sequence: int) -> SampleBatch:
    n = len(gyro)
    return SampleBatch(
        device="chest",
        boot=1,
        sequence=sequence,
        receive_time_ns=0,
        start_time_ns=0,
        tick_period_s=1e-6,
        clock_rate=1.0,
        ticks=ticks[:n].astype(np.uint64),
        gyro=gyro.astype(np.float32),
        accel=None,
        temperature_c=None,
        flags=np.zeros(n, np.uint32),
    )


@pytest.mark.parametrize("hours", [0.5, 10.0])
def test_a_clock_that_wrapped_while_the_bridge_was_away_makes_nobody_sure(hours: float) -> None:
    session = simulate_session(5)
    device = DeviceSession("chest")
    device.begin_boot(1, 0.0, None)
    n = len(session.ticks)
    for i in range(0, n, 5):
        device.handle(raw(session.gyro[i : i + 5], session.ticks[i : i + 5], i))
    before = device.status(0)
    assert before.quality is Quality.GOOD
    late = replace(raw(session.gyro[:5], session.ticks[:5], n), receive_time_ns=int(hours * 3600e9))
    device.handle(late)
    for i in range(5, 300, 5):
        again = raw(session.gyro[i : i + 5] + 0.5, session.ticks[i : i + 5], n + i)
        device.handle(replace(again, receive_time_ns=late.receive_time_ns + i))
    after = device.status(0)
    walk = BiasKnobs().rate_random_walk * np.sqrt(hours * 3600)
    assert min(after.bias_std) > walk * 0.9
    assert after.evidence_age_s > hours * 3600 * 0.9
    if hours > 1:
        assert after.quality is Quality.DEGRADED


def test_a_turn_that_no_longer_counts_is_asked_for_again() -> None:
    session = simulate_session(5, rests_s=(3.2, 640.0, 3.2, 3.2))
    device = DeviceSession("chest")
    device.begin_boot(1, 0.0, None)
    for i in range(0, len(session.ticks), 50):
        device.handle(raw(session.gyro[i : i + 50], session.ticks[i : i + 50], i))
    status = device.status(0)
    assert status.state is State.TURNING
    assert len(status.axes_done) == 2
    assert Code.TURNS_NEEDED in codes(status.reason)


def test_a_dead_accelerometer_is_no_witness() -> None:
    session = simulate_session(5)
    for accel in (np.zeros_like(session.accel), session.accel / 9.81):
        recording = Recording(session.time_s, session.gyro, accel, None, session.rate_hz, "dead")
        for method in ("closure", "turn360"):
            result, _ = offline.calibrate(recording, method)
            assert result.verdict is Verdict.ACCEPTED, result.reason
        for method in ("transitions", "accel_aided"):
            assert offline.calibrate(recording, method)[0].verdict is Verdict.REFUSED


def test_one_axis_is_repeated_without_starting_over() -> None:
    session = simulate_session(5, turns=(TurnPlan(0), TurnPlan(1), TurnPlan(2), TurnPlan(0)))
    gyro = session.gyro.copy()
    middle = int(session.stages[1].mean())
    gyro[middle - 10 : middle + 10, 1] += np.radians(8.0) * session.rate_hz / 20 / session.truth.k[1]
    device = DeviceSession("chest")
    device.begin_boot(1, 0.0, None)
    heard = []
    for i in range(0, len(session.ticks), 5):
        outcome = device.handle(raw(gyro[i : i + 5], session.ticks[i : i + 5], i))
        heard += [(made, device.status(0)) for made in outcome.calibrations]
    (first, then), (second, _) = heard
    assert first.verdict is Verdict.REPEAT
    assert Code.TURNS_OPEN in codes(first.reason)
    assert (then.state, then.axes_done) == (State.TURNING, (1, 2))
    assert second.verdict is Verdict.ACCEPTED
    assert np.diag(second.matrix) == pytest.approx(session.truth.k, abs=1e-3)
    uploaded = DeviceSession("chest")
    uploaded.begin_boot(1, 0.0, None)
    at_once = uploaded.handle(raw(gyro, session.ticks, 0))
    assert [made.reason for made in at_once.calibrations] == [first.reason, second.reason], "neither is lost"
