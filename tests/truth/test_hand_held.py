import numpy as np
import pytest

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Piece, Still, Swing, Turn
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, session
from estimator.calibration.capture import Rest, Samples
from estimator.calibration.gravity_propagation import TransitionKnobs, collect
from estimator.calibration.transitions import fit
from estimator.geometry.gyro_model import least_step
from tests.estimator.stream import Stream, stream
from tests.truth.hand_held import hand_held


def trembling(rng: np.random.Generator, seconds: float) -> Swing:
    """A hand that means to be still: it comes back to where it was, and has swayed by a degree or two meanwhile."""
    waves = np.zeros((6, 3))
    waves[3:] = np.radians(0.7) * rng.normal(size=(3, 3))
    return Swing(seconds, np.zeros(3), waves, np.zeros((6, 3)))


def held(seed: int) -> Stream:
    """Still on a table, then held: two turns about x with trembling pauses and never a rest."""
    rng = np.random.default_rng(seed)
    plan = SessionPlan(rests_s=1.0, turns=(TurnPlan(0, 355.0), TurnPlan(0, 362.0)), turn_s=(4.0, 5.0), wobble_deg=5.0)
    turns = [piece for piece in session(rng, plan) if isinstance(piece, Turn)]
    pieces: list[Piece] = [
        Still(8.0),
        trembling(rng, 2.0),
        turns[0],
        trembling(rng, 2.0),
        turns[1],
        trembling(rng, 2.0),
    ]
    spec = ImuSpec(noise_dps=0.05, accel_noise=0.05)
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=spec)


def test_single_turns_held_by_hand_give_their_scale() -> None:
    for seed in range(4):
        of = held(seed)
        start = of.at(7.5)
        gyro = of.gyro[: of.at(7.0)]
        rest = Rest(0.0, 7.0, gyro.mean(axis=0), gyro.std(axis=0, ddof=1), least_step(gyro), len(gyro), None)
        part = of.part(start, len(of))
        turns = hand_held(Samples(part.time, part.gyro, part.accel, np.zeros(len(part), bool)), rest)
        whole = [turn for turn in turns if turn.after.start - turn.before.end > 3.5]
        assert len(whole) == 2
        for turn in whole:
            found = fit(collect([turn]), TransitionKnobs(accel_floor=0.05))
            error, std = found.theta[3] - of.truth.k[0], np.sqrt(found.covariance[3, 3])
            assert abs(error) < 0.003
            assert abs(error) < 3 * std


def test_without_an_accelerometer_there_are_no_poses() -> None:
    of = held(0)
    rest = Rest(0.0, 1.0, np.zeros(3), np.ones(3), np.ones(3), 100, None)
    with pytest.raises(ValueError, match="accelerometer"):
        hand_held(Samples(of.time, of.gyro, None, np.zeros(len(of), bool)), rest)
