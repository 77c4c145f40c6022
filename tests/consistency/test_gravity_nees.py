"""The deviations of both gravity methods with default knobs, by a simulator that shares no code with them.

NEES per degree of freedom of the scale k (3) and of the matrix (9); 1 when deviations are right. Over 40 sessions: 0.5 to 1.4.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.wire.messages import Verdict
from estimator.calibration.gravity_propagation import COLUMN, ROW
from estimator.offline import recordings
from tests.sim.pose_simulator import Device, Hand, Move, simulate


def sides(rng: np.random.Generator) -> list[Move]:
    """The procedure that `truerate calibrate --help` recommends: six sides, quarter, half and full turns about every axis."""
    moves: list[Move] = []

    def turn(axis: int, quarters: int) -> None:
        vector = [0.0, 0.0, 0.0]
        vector[axis] = quarters * np.pi / 2
        moves.append(Move((vector[0], vector[1], vector[2]), rng.uniform(0.8, 1.4) * (1 + 0.8 * abs(quarters))))

    # Flat, x and y are level; on its x side y and z are.
    for axis in (0, 1):
        sign = int(rng.choice([-1, 1]))
        for quarters in (sign, sign, -2 * sign, 4 * sign):
            turn(axis, quarters)
    turn(1, int(rng.choice([-1, 1])))
    sign = int(rng.choice([-1, 1]))
    for quarters in (sign, sign, 2 * sign, -sign, 4 * sign):
        turn(2, quarters)
    return moves


def anyhow(rng: np.random.Generator) -> list[Move]:
    """15 random poses: turns of 60 to 170 degrees about any axis."""
    moves = []
    for _ in range(14):
        axis = rng.normal(size=3)
        x, y, z = axis / np.linalg.norm(axis) * rng.choice([-1, 1]) * np.radians(rng.uniform(60, 170))
        moves.append(Move((x, y, z), rng.uniform(1.5, 3.0)))
    return moves


def nees(method: str, device: Device, hand: Hand, seed: int) -> tuple[float, float]:
    """Of k and of the whole matrix, of a session that has to be accepted and right."""
    plan = sides if method == "sides" else anyhow
    of = simulate(seed, plan(np.random.default_rng(seed + 10_000)), device, hand)
    true: NDArray[np.float64] = of.matrix
    if method == "accel_aided":
        # Its frame has the accelerometer's shape upper triangular, the simulator's has it symmetric.
        frame, triangular = np.linalg.qr(of.shape)
        true = (frame * np.sign(np.diag(triangular))).T @ of.matrix
    recording = Recording(of.time, of.gyro, of.accel, None, of.rate_hz, "")
    result, _ = recordings.calibrate(recording, "accel_aided" if method == "accel_aided" else "transitions")
    assert result.verdict is Verdict.ACCEPTED, result.reason
    error, covariance = (result.matrix - true)[ROW, COLUMN], result.covariance[3:, 3:]
    assert (np.abs(error) <= np.maximum(0.01, 4 * np.sqrt(np.diag(covariance)))).all()
    return (
        float(error[:3] @ np.linalg.solve(covariance[:3, :3], error[:3])) / 3,
        float(error @ np.linalg.solve(covariance, error)) / 9,
    )


@pytest.mark.parametrize(
    ("method", "device", "hand", "most"),
    [
        ("sides", Device(), Hand(), 1.6),
        ("poses", Device(drift_dps_per_min=0.1), Hand(), 1.6),
        ("sides", Device(), Hand(creep_dps=0.4), 2.5),
        ("accel_aided", Device(), Hand(), 1.6),
        ("accel_aided", Device(drift_dps_per_min=0.1), Hand(), 1.6),
        ("accel_aided", Device(g_sensitivity_dps_per_g=0.1), Hand(), 2.5),
    ],
    ids=["sides", "poses, drift", "sides, creep", "accel_aided", "accel_aided, drift", "accel_aided, g-sensitive"],
)
def test_deviations_are_what_sessions_are_off_by(method: str, device: Device, hand: Hand, most: float) -> None:
    found = np.mean([nees(method, device, hand, seed) for seed in range(8)], axis=0)
    assert (found > 0.25).all()
    assert (found < most).all()
