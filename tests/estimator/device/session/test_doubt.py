"""A bias that is doubted, and what ends the doubt."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, swing
from bridge.wire.messages import Quality, State
from estimator.device.session import DeviceSession
from estimator.tracking import bias_monitor
from tests.estimator.device.session.lives import again, calibrated, off, state
from tests.estimator.stream import NAME, Stream, calibration, feed, rates, stream
from tests.sentences import codes, free


def test_a_bias_that_jumps_is_doubted_then_learnt(once: Stream) -> None:
    device = calibrated(once)
    n = len(once)
    first = off(once, 0.6, 20.0)
    outcome = feed(device, first.batches(first=n))
    assert outcome.corrected[-1].quality is Quality.DEGRADED
    assert state(device) is State.DEGRADED
    [said] = [one.params["rate_dps"] for one in device.life.reason if one.code == Code.REST_CONTRADICTS_BIAS]
    assert float(said) == pytest.approx(0.6, abs=0.05)
    more = off(first, 0.0, 130.0)
    more = replace(more, gyro=more.gyro + first.gyro.mean(axis=0) - more.gyro.mean(axis=0))
    outcome = feed(device, more.batches(first=n + len(first)))
    assert np.abs(np.degrees(rates(outcome.corrected[-50:]).mean(axis=0))).max() < 0.05, "learnt at last"
    assert state(device) is State.DEGRADED, "but it may be turning still"
    moved = stream([swing(np.random.default_rng(0), 3.0, 1.0), Still(15.0)], 18.0, seed=78)
    bias = first.gyro.mean(axis=0)
    ticks = moved.ticks + more.ticks[-1] + 1_000_000  # a gap: it goes on in another pose
    moved = replace(moved, ticks=ticks, gyro=moved.gyro - moved.bias + bias)
    moved = replace(moved, temperature_c=np.full(len(moved), more.temperature_c[-1]))
    outcome = feed(device, moved.batches(first=n + len(first) + len(more)))
    assert state(device) is State.TRACKING, "the same at another rest: it was the bias"
    assert outcome.corrected[-1].quality is Quality.GOOD


def test_a_slow_turn_of_a_minute_is_not_swallowed(once: Stream) -> None:
    device = calibrated(once)
    k = once.truth.k[2]
    outcome = feed(device, off(once, 0.3 / k, 60.0).batches(first=len(once)))
    seen = np.degrees(rates(outcome.corrected)[:, 2].astype(float)).sum() / 104.0
    assert seen == pytest.approx(18.0, abs=0.6)


def test_asking_for_a_recalibration_makes_no_doubt_go_away(once: Stream) -> None:
    device = calibrated(once)
    doubtful = off(once, 0.6, 20.0)
    feed(device, doubtful.batches(first=len(once)))
    assert state(device) is State.DEGRADED
    assert device.recalibrate("nurse", "") is None
    moving = calibration(TurnPlan(0), seed=1, before_s=0.0, plan=SessionPlan(0.2, (TurnPlan(0, swing=True),)))
    going_on = replace(moving, ticks=moving.ticks + doubtful.ticks[-1])
    outcome = feed(device, going_on.batches(first=len(once) + len(doubtful)))
    assert all(b.quality is Quality.DEGRADED for b in outcome.corrected)
    assert device.cancel("nurse") is None
    assert state(device) is State.DEGRADED
    assert device.status(1).quality is Quality.DEGRADED


def test_a_new_calibration_ends_a_doubt_at_once(once: Stream) -> None:
    device = calibrated(once)
    doubtful = off(once, 0.6, 20.0)
    feed(device, doubtful.batches(first=len(once)))
    assert device.recalibrate("nurse", "") is None
    more = again(once)
    more = replace(
        more, ticks=more.ticks + doubtful.ticks[-1] - once.ticks[-1], gyro=more.gyro + np.radians([0, 0, 0.6])
    )
    outcome = feed(device, more.batches(first=len(once) + len(doubtful)))
    assert outcome.calibration is not None
    new = [b for b in outcome.corrected if b.calibration == outcome.calibration.id]
    old = [b for b in outcome.corrected if b.calibration != outcome.calibration.id]
    assert {b.quality for b in old} == {Quality.DEGRADED}
    assert {b.quality for b in new} == {Quality.GOOD}


def test_without_rest_the_uncertainty_grows_and_is_degraded_at_last(
    once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As far as the bias walks by itself: at an even temperature, what is not known of warmth would hide it."""
    monkeypatch.setattr(bias_monitor, "EVIDENCE_AGE_S", 60.0)
    device = DeviceSession(NAME)
    feed(device, replace(once, temperature_c=np.full(len(once), 30.0)).batches())
    rng = np.random.default_rng(0)
    busy = [swing(rng, 5.0, np.radians(120.0)) for _ in range(20)]
    moving = stream(busy, 99.0)
    even = np.full(len(moving), 30.0)
    moving = replace(moving, ticks=moving.ticks + once.ticks[-1], temperature_c=even, truth=once.truth)
    # Another device's gyro moves: gravity would not agree with it.
    corrected = feed(device, moving.batches(first=len(once), accel=False)).corrected
    stds = np.array([b.bias_std.max() for b in corrected])
    assert stds[-1] > 1.5 * stds[0]
    # Deviations are those of corrected rates: the axis with the largest scale factor.
    walk = device.knobs.track.bias.rate_random_walk * np.sqrt(99.0) * once.truth.k.max()
    # A little faster than the model says, until rests have shown how fast.
    assert 0.9 * walk < np.sqrt(stds[-1] ** 2 - stds[0] ** 2) < 1.4 * walk
    assert corrected[0].quality is Quality.GOOD
    assert corrected[-1].quality is Quality.DEGRADED
    assert Code.NO_REST_FOR in codes(device.life.reason)


@pytest.fixture
def rested() -> Stream:
    """Never turned."""
    return stream([Still(12.0)], 12.0, seed=3)


def test_of_a_bias_in_doubt_nobody_says_that_it_is_known(rested: Stream) -> None:
    """It stayed BIAS_ONLY, sure to 0.02 °/s and off by 0.25, for two minutes."""
    device, doubtful = DeviceSession(NAME), off(rested, 0.25, 20.0)
    feed(device, rested.batches())
    assert device.status(1).quality is Quality.BIAS_ONLY
    outcome = feed(device, doubtful.batches(first=len(rested)))
    to_do = (Code.TURN_NOW(axes="x, y, z"),)
    assert outcome.changed
    assert (state(device), device.status(1).quality) == (State.BIAS_ONLY, Quality.NONE)
    assert codes(device.status(1).reason) == [*codes(to_do), Code.REST_CONTRADICTS_BIAS]
    device.life.say(free("went back and forth"))
    assert codes(device.status(1).reason) == [Code.PROFILE_NOTICE, Code.REST_CONTRADICTS_BIAS]
    device.life.say(to_do)
    back = off(doubtful, 0.0, 20.0)
    back = replace(back, gyro=back.gyro + (rested.gyro.mean(axis=0) - back.gyro.mean(axis=0)))
    outcome = feed(device, back.batches(first=len(rested) + len(doubtful)))
    assert outcome.said == [english(Code.BIAS_CONFIRMED())]
    assert (device.status(1).quality, device.status(1).reason) == (Quality.BIAS_ONLY, to_do)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_turns_of_a_gyro_whose_scale_is_not_known_raise_no_doubt(seed: int) -> None:
    """Gravity, carried by a scale that is off by a tenth, disagreed with every other one."""
    device = DeviceSession(NAME)
    qualities = [batch.quality for batch in feed(device, calibration(seed=seed).batches()).corrected]
    first = qualities.index(Quality.BIAS_ONLY)
    assert set(qualities[first:]) == {Quality.BIAS_ONLY, Quality.GOOD}
