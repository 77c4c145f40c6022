"""The whole tracker, fed sample by sample: what it must do whatever the stream is cut into, and what it learns of."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import swing
from estimator.tracking.bias_state import BIAS, SLOPE
from tests.estimator.stream import Stream, stream
from tests.estimator.tracking.worn import LEVEL, PLAIN, Worn, rest


def busy(seconds: float, *, seed: int = 0, resting_s: float = 0.0, spec: ImuSpec = PLAIN) -> Stream:
    """A wearer who never rests, but for a while at either end."""
    rng = np.random.default_rng(seed)
    moves: list[Piece] = [swing(rng, 4.0, np.radians(90.0)) for _ in range(round(seconds / 4))]
    pieces = [Still(resting_s), *moves, Still(resting_s)] if resting_s else moves
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=spec, attitude=LEVEL)


@pytest.fixture(scope="module")
def day() -> Stream:
    return busy(24.0, seed=3, resting_s=8.0)


# ---- with less than all -------------------------------------------------------------------------------------------


def test_an_accelerometer_that_is_lost_half_way_stops_nothing(day: Stream) -> None:
    half, worn = day.at(20.0), Worn.new()
    worn.lives(day.part(0, half))
    with_it = {r.kind for r in worn.receipts}
    worn.receipts.clear()
    worn.lives(day.part(half, len(day)), accel=False)
    assert with_it >= {"zaru level", "zaru vertical"}
    assert {r.kind for r in worn.receipts if r.time > day.time[half] + 3} == {"zaru"}
    assert all(r.accepted for r in worn.receipts)
    assert (np.abs(worn.error_dps(day)) < 3 * np.degrees(worn.tracker.std)).all()


# ---- what it learns -----------------------------------------------------------------------------------------------


def test_a_slope_by_temperature_is_learnt() -> None:
    warming = replace(PLAIN, bias_dps_per_kelvin=0.03, temperature_c=(25.0, 35.0), warm_up_s=300.0)
    of = rest(150.0, seed=4, spec=warming)
    worn = Worn.new().lives(of, temperature=True)
    state = worn.tracker.state
    error, std = state.x[SLOPE] - of.truth.bias_per_kelvin, np.sqrt(np.diag(state.P)[SLOPE])
    assert (np.abs(error) < 3 * std + np.radians(1e-3)).all()
    assert np.abs(error).max() < 0.2 * np.abs(of.truth.bias_per_kelvin).max()
    assert (np.abs(worn.error_dps(of)) < 0.01).all()


@pytest.mark.parametrize("seed", [2, 4])
@pytest.mark.parametrize("accel", [True, False])
def test_a_fast_warming_at_rest_is_followed_and_its_slope_learnt(seed: int, accel: bool) -> None:
    warming = replace(PLAIN, bias_dps_per_kelvin=0.03, temperature_c=(25.0, 35.0), warm_up_s=60.0)
    of = rest(150.0, seed=seed, spec=warming)
    worn = Worn.new().lives(of, temperature=True, accel=accel)
    assert any(r.kind.startswith("bounded") for r in worn.receipts), "it drifts too fast to look like a rest at first"
    assert all(r.accepted for r in worn.receipts)
    state = worn.tracker.state
    error, std = state.x[SLOPE] - of.truth.bias_per_kelvin, np.sqrt(np.diag(state.P)[SLOPE])
    assert (np.abs(error) < 3 * std).all()
    assert (np.abs(worn.error_dps(of)) < 0.01).all()


@pytest.mark.parametrize("silent_s", [60.0, 600.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_what_has_cooled_in_a_silence_is_followed_at_once(seed: int, silent_s: float) -> None:
    """The last second before the gap was taken for one at the temperature after it: 0.1 °/s off, for minutes."""
    spec = replace(PLAIN, bias_dps_per_kelvin=0.03, temperature_c=(25.0, 35.0), warm_up_s=200.0)
    warm = rest(200.0, seed=seed, spec=spec)
    cold = warm.part(0, warm.at(30.0))
    cold = replace(cold, ticks=cold.ticks + warm.ticks[-1] + round(silent_s * 1e6))
    worn = Worn.new().lives(warm, temperature=True)
    before = len(worn.time)
    worn.lives(cold, temperature=True)
    began = warm.time[-1] + silent_s
    known = [i for i in range(before, len(worn.time)) if worn.time[i] > began + 2.0]
    truth = cold.bias[np.searchsorted(cold.time, np.array(worn.time)[known]) - 1]
    assert (np.abs(np.array(worn.bias)[known] - truth) < 4 * np.array(worn.std)[known]).all()
    assert (np.abs(worn.error_dps(cold)) < 0.01).all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_wrong_bias_is_found_in_motion_alone(seed: int) -> None:
    of = busy(80.0, seed=seed)
    off = np.radians([0.6, -0.8, 0.5])
    worn = Worn.new(of.bias[0] + off, bias_std_dps=1.0).lives(of)
    assert worn.receipts == [], "it never rested"
    std = np.degrees(worn.tracker.std)
    assert (std < 0.3).all(), "it has learnt of it"
    assert (np.abs(worn.error_dps(of)) < 3 * std).all()
    unaided = Worn.new(of.bias[0] + off, bias_std_dps=1.0).lives(of, accel=False)
    np.testing.assert_allclose(unaided.tracker.state.x[BIAS], of.bias[0] + off)
