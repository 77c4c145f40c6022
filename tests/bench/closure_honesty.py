"""Honesty of hand-made calibrations: how far k is off, in the standard deviations that are told with it.

    python -m tests.bench.closure_honesty [--runs 200] [--method closure] [--only WORD]

A row a kind of session, simulated with errors that the calibration is not told of. NEES of k is the mean of
error' covariance^-1 error / 3: 1 where the deviations are right, below it where they are too wide. "beyond 2 std" should be
5 %. A session is wrong if it is accepted with a factor off by more than 1 % and more than 4 standard deviations.
"""

import argparse
import multiprocessing
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bridge.reasons.catalogue import english
from bridge.recording import Recording
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, draw
from bridge.sim.motion import Motion, Piece, Spin, Turn
from bridge.sim.motion_scripts import SessionPlan, flat, session
from bridge.wire.messages import Verdict
from estimator.offline import recordings

Floats = NDArray[np.float64]
RATE_HZ, FULL_SCALE = 104.0, np.radians(250.0)


@dataclass(frozen=True, slots=True)
class Kind:
    """Errors of a session; angles in degrees, rates in °/s.

    misalignment: each off-diagonal element of M, relative, with a sign at random. cubic, bent: relative error of a reading at
    full scale, growing with the square or the size of the rate. creep_dps: a slow rotation of 1 s before or after each turn.
    """

    replacement_deg: float = 0.2
    tilt_deg: float = 3.0
    wobble_deg: float = 1.0
    noise_dps: float = 0.07
    walk_dps: float = 7e-4
    accel_bias: float = 0.0
    misalignment: float = 0.0
    cubic: float = 0.0
    bent: float = 0.0
    creep_dps: float = 0.0
    creep_after: bool = False


KINDS: dict[str, Kind] = {
    **{f"re-placement {miss:g}°": Kind(replacement_deg=miss) for miss in (0.0, 0.2, 1.0)},
    "re-placement 0°, no tilt, no wobble": Kind(0.0, 0.0, 0.0),
    "re-placement 0°, noise 0.15 °/s": Kind(0.0, noise_dps=0.15),
    "re-placement 0.2°, accelerometer offset 30 mg": Kind(accel_bias=0.3),
    "misalignment 1 %": Kind(misalignment=0.01),
    "misalignment 5 %": Kind(misalignment=0.05),
    "non-linearity 1 %, with the square": Kind(cubic=0.01),
    "non-linearity 1 %, with the size": Kind(bent=0.01),
    **{
        f"creep of {creep:g} °/s {'after' if after else 'before'}": Kind(creep_dps=creep, creep_after=after)
        for creep in (0.3, 0.5)
        for after in (False, True)
    },
}


def simulated(kind: Kind, seed: int, *, accel: bool) -> tuple[Recording, Floats]:
    """A session of this kind as a recording, and its true scale factors (3,)."""
    script_rng, device_rng = np.random.default_rng(seed).spawn(2)
    plan = SessionPlan(3.0, None, (4.0, 6.0), kind.wobble_deg, kind.tilt_deg, kind.replacement_deg)
    pieces = list(_crept(session(script_rng, plan), kind))
    time = np.arange(1, int(sum(piece.duration_s for piece in pieces) * RATE_HZ) + 1) / RATE_HZ
    motion = Motion(pieces, flat(script_rng)).advance(time)
    spec = ImuSpec(
        scale=(0.95, 1.05),
        noise_dps=kind.noise_dps,
        rrw_dps_per_sqrt_s=kind.walk_dps,
        accel_bias=kind.accel_bias,
        range_dps=250.0,
    )
    truth = draw(spec, device_rng)
    if kind.misalignment:
        across = kind.misalignment * device_rng.choice([-1.0, 1.0], (3, 3)) * (1 - np.eye(3))
        truth = replace(truth, matrix=truth.k[:, None] * (np.eye(3) + across))
    readings = ImuErrorModel(spec, device_rng, truth).read(motion)
    share = np.abs(readings.gyro - readings.bias) / FULL_SCALE
    gyro = readings.gyro + (readings.gyro - readings.bias) * (kind.cubic * share**2 + kind.bent * share)
    return Recording(time, gyro, readings.accel if accel else None, None, RATE_HZ, "simulated"), truth.k


def _crept(pieces: list[Piece], kind: Kind) -> list[Piece]:
    """The same with 1 s of creep beside each turn; turn and creep together still make the angle that was meant."""
    if not kind.creep_dps:
        return pieces
    found: list[Piece] = []
    for piece in pieces:
        if not isinstance(piece, Turn):
            found.append(piece)
            continue
        rate = np.copysign(np.radians(kind.creep_dps), piece.angle)
        creep = Spin(1.0, piece.axis, float(rate), ramp_s=0.1)
        turn = replace(piece, angle=piece.angle - 0.9 * float(rate))
        found += [turn, creep] if kind.creep_after else [creep, turn]
    return found


def tried(job: tuple[str, bool, int, str]) -> tuple[str, bool, Verdict, Floats, Floats, str]:
    """One session: its kind, whether with an accelerometer, verdict, error of k (3,), covariance of k (3, 3), reason."""
    name, accel, seed, method = job
    recording, k = simulated(KINDS[name], seed, accel=accel)
    result, _ = recordings.calibrate(recording, method)
    return name, accel, result.verdict, result.scale - k, result.covariance[3:6, 3:6], english(*result.reason)


def row(found: list[tuple[Verdict, Floats, Floats, str]]) -> tuple[str, ...]:
    """The figures of one kind."""
    accepted = [(error, cov) for verdict, error, cov, _ in found if verdict is Verdict.ACCEPTED]
    if not accepted:
        return (f"0/{len(found)}", *[""] * 5)
    error, cov = (np.array(each) for each in zip(*accepted, strict=True))
    nees = np.einsum("si,sij,sj->s", error, np.linalg.inv(cov), error) / 3
    std = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    beyond = np.abs(error) > 2 * std
    wrong = np.any((np.abs(error) > 0.01) & (np.abs(error) > 4 * std), axis=1)
    rms = np.sqrt(np.mean(error**2))
    return (
        f"{len(accepted)}/{len(found)}",
        f"{wrong.sum()}",
        f"{nees.mean():.2f}",
        f"{100 * beyond.mean():.1f}",
        f"{100 * rms:.4f}",
        f"{100 * np.median(std):.4f}",
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.closure_honesty", description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="sessions of each kind")
    parser.add_argument("--method", default="closure")
    parser.add_argument("--only", default="", metavar="WORD", help="kinds whose name has this in it")
    given = parser.parse_args()
    jobs = [
        (name, accel, seed, given.method)
        for name in KINDS
        if given.only in name
        for accel in (False, True)
        for seed in range(given.runs)
    ]
    found: dict[tuple[str, bool], list[tuple[Verdict, Floats, Floats, str]]] = defaultdict(list)
    console = Console()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        each = track(
            pool.imap(tried, jobs, chunksize=8), "calibrating", total=len(jobs), console=console, transient=True
        )
        for name, accel, verdict, error, covariance, reason in each:
            found[name, accel].append((verdict, error, covariance, reason))
    table = Table(box=None, pad_edge=False)
    for heading in ("session", "accel", "accepted", "wrong", "NEES k", "beyond 2 std, %", "k rms, %", "std told, %"):
        table.add_column(heading, justify="left" if heading == "session" else "right")
    for (name, accel), of in found.items():
        table.add_row(name, "yes" if accel else "no", *row(of))
    console.print(table)


if __name__ == "__main__":
    main()
