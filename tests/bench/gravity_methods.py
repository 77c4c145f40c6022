"""Measures how honest the deviations of `transitions` and `accel_aided` are in simulated sessions.

NEES per degree of freedom is 1 when deviations are right. The table shows it for the scale k (3) and for the matrix (9), over
accepted sessions. Wrong: accepted, and any element is off by more than 0.01 and more than 4 standard deviations. Two
simulators that share no code with the estimator: pose_simulator beside this file, and the bridge's ("bridge").
`python -m tests.bench.gravity_methods [--runs N] [--only WORDS]`.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bridge.reasons.catalogue import english
from bridge.recording import Recording
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec
from bridge.sim.motion import Motion
from bridge.sim.motion_scripts import flat, poses
from bridge.wire.messages import Verdict
from estimator.calibration.gravity_propagation import COLUMN, ROW
from estimator.offline import recordings
from tests.bench.pose_simulator import Device, Hand, Move, simulate

Floats = NDArray[np.float64]
Plan = Callable[[np.random.Generator], list[Move]]
_RATE_HZ = 104.0


def sides(rng: np.random.Generator, full_turns: int = 1) -> list[Move]:
    """The procedure that `truerate calibrate --help` recommends: six sides, quarter, half and full turns about every axis."""
    moves: list[Move] = []

    def turn(axis: int, quarters: int) -> None:
        vector = [0.0, 0.0, 0.0]
        vector[axis] = quarters * np.pi / 2
        moves.append(Move((vector[0], vector[1], vector[2]), rng.uniform(0.8, 1.4) * (1 + 0.8 * abs(quarters))))

    # Flat, x and y are level; on its x side y and z are.
    for axis in (0, 1):
        sign = int(rng.choice([-1, 1]))
        for quarters in (sign, sign, -2 * sign, *full_turns * (4 * sign,)):
            turn(axis, quarters)
    turn(1, int(rng.choice([-1, 1])))
    sign = int(rng.choice([-1, 1]))
    for quarters in (sign, sign, 2 * sign, -sign, *full_turns * (4 * sign,)):
        turn(2, quarters)
    return moves


def anyhow(rng: np.random.Generator, movements: int = 14) -> list[Move]:
    """Random poses: turns of 60 to 170 degrees about any axis."""
    moves = []
    for _ in range(movements):
        axis = rng.normal(size=3)
        x, y, z = axis / np.linalg.norm(axis) * rng.choice([-1, 1]) * np.radians(rng.uniform(60, 170))
        moves.append(Move((x, y, z), rng.uniform(1.5, 3.0)))
    return moves


def three_turns(rng: np.random.Generator) -> list[Move]:
    """The session of the other methods: a full turn about each axis."""
    turns = np.eye(3)[rng.permutation(3)] * 2 * np.pi * rng.choice([-1, 1], (3, 1))
    return [Move((x, y, z), rng.uniform(3.5, 6.0)) for x, y, z in turns]


@dataclass(frozen=True, slots=True)
class Case:
    """A method, a procedure, and errors of device and hand. bridge: simulate 15 random poses by the bridge's simulator."""

    plan: Plan = sides
    device: Device = field(default_factory=Device)
    hand: Hand = field(default_factory=Hand)
    method: str = "transitions"
    bridge: bool = False


def _cases(method: str) -> dict[str, Case]:
    case = partial(Case, method=method)
    procedures: dict[str, Plan] = {
        "six sides, full turns": sides,
        "six sides": partial(sides, full_turns=0),
        "15 poses anyhow": anyhow,
        "8 poses anyhow": partial(anyhow, movements=7),
        "three full turns": three_turns,
    }
    if method == "accel_aided":
        procedures = {
            "15 poses anyhow": anyhow,
            "20 poses anyhow": partial(anyhow, movements=19),
            "9 poses anyhow": partial(anyhow, movements=8),
        }
    noisy = Device(noise_dps=0.15, accel_noise=0.06)
    found = {what: case(plan) for what, plan in procedures.items()}
    found |= {f"{what}; noise 0.15": case(plan, noisy) for what, plan in procedures.items()}
    devices = {
        "accel offset 0": Device(accel_offset=0.0),
        "accel offset 60 mg, scale 2 %": Device(accel_offset=0.6, accel_scale=0.02),
        "drift 0.1 °/s/min": Device(drift_dps_per_min=0.1),
        "drift 0.1; noise 0.15": Device(noise_dps=0.15, accel_noise=0.06, drift_dps_per_min=0.1),
        "walk 7e-4 °/s/√s": Device(walk_dps_per_sqrt_s=7e-4),
        "walk 2e-3 °/s/√s": Device(walk_dps_per_sqrt_s=2e-3),
        "(*) 1 % nonlinear": Device(nonlinearity=0.01),
        "(*) 0.1 °/s/g": Device(g_sensitivity_dps_per_g=0.1),
    }
    for what, plan in tuple(procedures.items())[:3:2] if method == "transitions" else tuple(procedures.items())[:1]:
        found |= {f"{what}; {error}": case(plan, device) for error, device in devices.items()}
        hands = {
            "(*) creep 0.4 °/s": Hand(creep_dps=0.4),
            "(*) sway 0.02°, 0.03 m/s²": Hand(sway_deg=0.02, sway_accel=0.03),
            "re-placement 1°": Hand(replacement_deg=1.0),
        }
        found |= {f"{what}; {error}": case(plan, hand=hand) for error, hand in hands.items()}
    found["bridge, 15 poses"] = case(bridge=True)
    found["bridge, 15 poses; noise 0.15"] = case(bridge=True, device=noisy)
    found["bridge, 15 poses; walk 2e-3 °/s/√s"] = case(bridge=True, device=Device(walk_dps_per_sqrt_s=2e-3))
    return {f"{method}: {what}": one for what, one in found.items()}


CASES: Mapping[str, Case] = _cases("transitions") | _cases("accel_aided")


class Score(NamedTuple):
    """Of one session: NEES per degree of freedom, NaN where there is none; error and told deviation of k, rms, %."""

    accepted: bool
    wrong: bool
    nees_k: float
    nees_matrix: float
    error: float
    std: float
    reason: str


def recorded(case: Case, seed: int) -> tuple[Recording, Floats]:
    """A session of a case and the true matrix."""
    if case.bridge:
        return _by_bridge(case.device, seed)
    of = simulate(seed, case.plan(np.random.default_rng(seed + 10_000)), case.device, case.hand, _RATE_HZ)
    matrix = of.matrix
    if case.method == "accel_aided":
        # Its frame has the accelerometer's shape upper triangular, the simulator's has it symmetric.
        frame, triangular = np.linalg.qr(of.shape)
        matrix = (frame * np.sign(np.diag(triangular))).T @ of.matrix
    return Recording(of.time, of.gyro, of.accel, None, of.rate_hz, ""), matrix


def _by_bridge(device: Device, seed: int) -> tuple[Recording, Floats]:
    script, part = np.random.default_rng(seed).spawn(2)
    pieces = poses(script, 14)
    time = np.arange(1, int(sum(piece.duration_s for piece in pieces) * _RATE_HZ) + 1) / _RATE_HZ
    spec = ImuSpec(
        scale=(1 - device.scale, 1 + device.scale),
        misalignment_deg=device.misalignment_deg,
        noise_dps=device.noise_dps,
        accel_noise=device.accel_noise,
        accel_bias=device.accel_offset,
        accel_scale=device.accel_scale,
        rrw_dps_per_sqrt_s=device.walk_dps_per_sqrt_s,
    )
    imperfection = ImuErrorModel(spec, part)
    readings = imperfection.read(Motion(pieces, flat(script)).advance(time))
    return Recording(time, readings.gyro, readings.accel, None, _RATE_HZ, ""), imperfection.truth.matrix


def score(case: Case, seed: int) -> Score:
    """Calibrate one session and compare with the truth."""
    recording, true = recorded(case, seed)
    result, _ = recordings.calibrate(recording, case.method)
    if result.verdict is not Verdict.ACCEPTED:
        return Score(False, False, np.nan, np.nan, np.nan, np.nan, english(*result.reason))
    full = len(result.parameters) == 12
    rows = slice(None) if full else slice(3)
    error = (result.matrix - true)[ROW, COLUMN][rows]
    covariance = result.covariance[3:, 3:]
    std = np.sqrt(np.diag(covariance))
    wrong = bool((np.abs(error) > np.maximum(0.01, 4 * std)).any())
    nees_k = float(error[:3] @ np.linalg.solve(covariance[:3, :3], error[:3])) / 3
    nees = float(error @ np.linalg.solve(covariance, error)) / 9 if full else np.nan
    off, told = (100 * float(np.sqrt(np.mean(of[:3] ** 2))) for of in (error, std))
    return Score(True, wrong, nees_k, nees, off, told, english(*result.reason))


def measured(case: Case, seeds: range, pool: ProcessPoolExecutor | None = None) -> list[Score]:
    """The scores of these seeds."""
    one = partial(score, case)
    return [one(seed) for seed in seeds] if pool is None else list(pool.map(one, seeds, chunksize=4))


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--runs", type=int, default=40, help="sessions of each case")
    asked.add_argument("--only", default="", help="cases whose names hold this")
    wanted = asked.parse_args()
    table = Table(title=f"{wanted.runs} sessions each; (*): errors beyond the model", title_justify="left", box=None)
    for heading in ("case", "accepted", "full", "wrong", "NEES: k", "matrix", "k off, %", "told, %"):
        table.add_column(heading, justify="left" if heading == "case" else "right", no_wrap=True)
    with ProcessPoolExecutor(2) as pool:
        for name, case in CASES.items():
            if wanted.only not in name:
                continue
            scores = [one for one in measured(case, range(wanted.runs), pool) if one.accepted]
            if not scores:
                table.add_row(name, "0")
                continue
            k, matrix, off, told = (np.array([s[i] for s in scores]) for i in (2, 3, 4, 5))
            whole = np.isfinite(matrix)
            table.add_row(
                name,
                str(len(scores)),
                str(whole.sum()),
                str(sum(one.wrong for one in scores)),
                f"{k.mean():.2f}",
                f"{matrix[whole].mean():.2f}" if whole.any() else "",
                f"{np.sqrt(np.mean(off**2)):.3f}",
                f"{np.sqrt(np.mean(told**2)):.3f}",
            )
    console = Console()
    console.width = max(console.width, 130)
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
