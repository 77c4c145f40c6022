import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.sim.motion import Motion, Piece, TrueMotion
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, demo_script, session

START = np.array([0.5, -0.5, 0.5, 0.5])


def times(duration_s: float, rate_hz: float = 104.0) -> NDArray[np.float64]:
    return np.arange(1, int(duration_s * rate_hz) + 1) / rate_hz


def angle_between(a: Rotation, b: Rotation) -> float:
    return float((a.inv() * b).magnitude())


def rotation(q: NDArray[np.float64]) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def integrated(motion: TrueMotion, start: Rotation) -> Rotation:
    """Attitude after the last sample, from the rates alone, by SciPy's rotations: a witness that shares no code."""
    dt = np.diff(motion.time_s, prepend=0.0)
    for step in Rotation.from_rotvec(motion.rate * dt[:, None]):
        start = start * step
    return start


def play(pieces: list[Piece], rate_hz: float = 104.0) -> TrueMotion:
    return Motion(pieces, START).advance(times(sum(piece.duration_s for piece in pieces) + 0.5, rate_hz))


PLANS = {
    "plain": SessionPlan(),
    "wobbling": SessionPlan(wobble_deg=5.0, tilt_deg=8.0),
    "in several goes": SessionPlan(turns=(TurnPlan(0, goes=3), TurnPlan(2, -360.0, goes=2), TurnPlan(1))),
    "twice round": SessionPlan(turns=(TurnPlan(1, 720.0), TurnPlan(1, -720.0)), wobble_deg=3.0),
}


@pytest.mark.parametrize("rate_hz", [12.5, 104.0])
@pytest.mark.parametrize("plan", PLANS.values(), ids=PLANS)
def test_full_turns_close_when_the_true_rate_is_integrated(plan: SessionPlan, rate_hz: float) -> None:
    motion = play(session(np.random.default_rng(3), plan), rate_hz)
    assert angle_between(rotation(START), integrated(motion, rotation(START))) < 1e-9
    assert angle_between(rotation(START), rotation(motion.attitude[-1])) < 1e-9


@pytest.mark.parametrize(("angle_deg", "left_deg"), [(330.0, 30.0), (180.0, 180.0), (-350.0, 10.0)])
def test_a_turn_of_a_wrong_angle_does_not_close(angle_deg: float, left_deg: float) -> None:
    motion = play(session(np.random.default_rng(0), SessionPlan(turns=(TurnPlan(2, angle_deg),))))
    assert np.degrees(angle_between(rotation(START), rotation(motion.attitude[-1]))) == pytest.approx(left_deg)


def test_replacement_error_is_as_asked() -> None:
    missed = [
        angle_between(rotation(START), rotation(play(session(np.random.default_rng(seed), plan), 10.0).attitude[-1]))
        for plan in [SessionPlan(rests_s=0.5, turns=(TurnPlan(0),), replacement_deg=0.2)]
        for seed in range(300)
    ]
    assert np.sqrt(np.mean(np.square(missed)) / 3) == pytest.approx(np.radians(0.2), rel=0.1)


def test_however_it_is_cut_it_is_the_same_motion() -> None:
    at = times(20.0)
    whole = demo_script(np.random.default_rng(9)).advance(at)
    cut = demo_script(np.random.default_rng(9))
    parts = [cut.advance(part) for part in np.split(at, [1, 2, 50, 777, 1500])]
    for name in ("rate", "attitude", "force"):
        np.testing.assert_allclose(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name), atol=1e-12)
