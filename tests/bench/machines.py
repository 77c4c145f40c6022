"""How honest calibrations on a turntable and a servo are: accepted, accepted wrong, and NEES of k, case by case.

python -m tests.bench.machines [--runs N] [--only WORD]: a quarter of an hour for 60 runs, with OPENBLAS_NUM_THREADS=1.
Two simulators: bridge.sim, and a witness that shares no code with it or the estimator. Wrong is off by more than 1 % and
by more than 4 standard deviations. NEES is (k - true)' cov⁻¹ (k - true) / 3, of the accepted; 1 when the covariance is right.
"""

import argparse
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.catalogue import english
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import machine
from bridge.wire.messages import Verdict
from estimator.calibration.bias_wander import WanderKnobs
from estimator.calibration.capture import Samples
from estimator.calibration.methods import BY_RATES
from estimator.calibration.result import Result
from tests.bench.machine_witness import Plan, Read, Unit, recorded
from tests.estimator.stream import stream

Floats = NDArray[np.float64]
X, Y, Z = np.eye(3)
ALIGNED, SIX = np.eye(3), np.vstack([np.eye(3), -np.eye(3)])
TABLE, SERVO = (30.0, 60.0, 90.0), (25.42,)


@dataclass(frozen=True)
class Case:
    """What is recorded, by seed, and the rates that are told."""

    name: str
    method: str
    rates: tuple[float, ...]
    read: Callable[[int], Read]


def both(rates: tuple[float, ...]) -> tuple[float, ...]:
    """Each rate in both directions."""
    return tuple(sign * rate for rate in rates for sign in (1.0, -1.0))


def askew(up: Floats) -> Callable[[int], Floats]:
    """The mountings, each tilted by some 15°, otherwise for each seed."""

    def mounts(seed: int) -> Floats:
        off = up + 0.2 * np.random.default_rng((5, seed)).normal(size=up.shape)
        return np.asarray(off / np.linalg.norm(off, axis=1)[:, None])

    return mounts


@dataclass(frozen=True)
class Witness:
    """The witness; the mountings may depend on the seed."""

    plan: Plan
    unit: Unit
    mounts: Callable[[int], Floats] | None = None

    def __call__(self, seed: int) -> Read:
        plan = self.plan if self.mounts is None else replace(self.plan, up=self.mounts(seed))
        return recorded(plan, self.unit, seed)


@dataclass(frozen=True)
class Simulated:
    """The project's simulator."""

    up: Floats
    rates: tuple[float, ...]
    spec: ImuSpec
    spin_s: float
    rest_s: float

    def __call__(self, seed: int) -> Read:
        pieces = machine(self.up, self.rates, spin_s=self.spin_s, rest_s=self.rest_s)
        of = stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=self.spec)
        return Read(of.time, of.gyro, of.accel, of.truth.k)


def cases() -> list[Case]:
    """All of them; the first of each method is the one with a goal."""
    return [*_servo(), *_table()]


def _servo() -> list[Case]:
    plan = Plan(ALIGNED, both(SERVO))
    mems = Unit(misalignment=0.5, offset=90.0)
    found: list[tuple[str, Witness | Simulated]] = [
        ("90 mg, x y z up", Witness(plan, mems)),
        ("no offset", Witness(plan, replace(mems, offset=0.0))),
        ("30 mg", Witness(plan, replace(mems, offset=30.0))),
        ("90 mg, six mountings", Witness(replace(plan, up=SIX), mems)),
        ("90 mg, no misalignment", Witness(plan, replace(mems, misalignment=0.0))),
        ("90 mg, accel scale 3 %", Witness(plan, replace(mems, accel_scale=0.03))),
        ("90 mg, rate 4e-4, bias at rest", Witness(plan, replace(mems, rate_share=4e-4, flicker=0.0, walk=0.0))),
        ("90 mg, rate 1e-4", Witness(plan, replace(mems, rate_share=1e-4))),
        ("90 mg, rate 5e-4", Witness(plan, replace(mems, rate_share=5e-4))),
        ("90 mg, rate 2e-3", Witness(plan, replace(mems, rate_share=2e-3))),
        ("askew, misalignment 0.57°", Witness(plan, replace(mems, misalignment=0.573), askew(ALIGNED))),
        ("askew, six, misalignment 0.57°", Witness(plan, replace(mems, misalignment=0.573), askew(SIX))),
        ("askew, no misalignment", Witness(plan, replace(mems, misalignment=0.0), askew(ALIGNED))),
        ("flicker 0.03", Witness(plan, replace(mems, flicker=0.03))),
        ("flicker 0.004, no walk", Witness(plan, replace(mems, flicker=0.004, walk=0.0))),
        ("noise 0.03", Witness(plan, replace(mems, noise=0.03))),
        ("noise 0.15", Witness(plan, replace(mems, noise=0.15))),
        ("warming 0.1 °/s/min", Witness(plan, replace(mems, drift=0.1 / 60))),
        ("g-sensitivity 0.1 °/s/g", Witness(plan, replace(mems, g_sensitivity=0.1))),
        ("spins and rests of 20 s", Witness(replace(plan, spin_s=20.0, rest_s=10.0), mems)),
        (
            "bridge.sim, 90 mg",
            Simulated(
                ALIGNED,
                both(SERVO),
                ImuSpec(
                    noise_dps=0.07,
                    bias_instability_dps=0.014,
                    rrw_dps_per_sqrt_s=7e-4,
                    accel_bias=1.53,
                    misalignment_deg=0.5,
                ),
                5.0,
                2.5,
            ),
        ),
    ]
    told = [Case(f"servo {name}", "servomotor", SERVO, read) for name, read in found]
    second = Witness(replace(plan, rates=(*both(SERVO), 32.0)), mems)
    return [
        *told,
        Case("servo wrong: 32 °/s among 25.42", "servomotor", SERVO, second),
        Case("servo wrong: told twice the rate", "servomotor", (50.84,), Witness(plan, mems)),
        Case(
            "servo also 6 °/s, not told", "servomotor", SERVO, Witness(replace(plan, rates=(*both(SERVO), 6.0)), mems)
        ),
    ]


def _table() -> list[Case]:
    plan = Plan(ALIGNED, both(TABLE), spin_s=23.6, rest_s=8.0)
    mems = Unit(misalignment=0.5)
    brief = replace(plan, spin_s=5.0, rest_s=2.5)
    found: list[tuple[str, Witness | Simulated]] = [
        ("640 s, flicker 0.014", Witness(plan, mems)),
        ("200 s", Witness(brief, mems)),
        ("1800 s", Witness(replace(plan, spin_s=80.0, rest_s=15.0), mems)),
        ("flicker 0.004", Witness(plan, replace(mems, flicker=0.004))),
        ("flicker 0.03", Witness(plan, replace(mems, flicker=0.03))),
        ("no flicker, no walk", Witness(plan, replace(mems, flicker=0.0, walk=0.0))),
        ("walk 3e-3", Witness(plan, replace(mems, walk=3e-3))),
        ("noise 0.03", Witness(plan, replace(mems, noise=0.03))),
        ("noise 0.15", Witness(plan, replace(mems, noise=0.15))),
        ("ramps of 3 s", Witness(replace(plan, ramp_s=3.0), mems)),
        ("50 Hz", Witness(replace(plan, rate_hz=50.0), mems)),
        ("rests of 2 s", Witness(replace(plan, rest_s=2.0), mems)),
        ("no rests", Witness(replace(plan, rest_s=0.0), mems)),
        ("table 3e-5, square 0.1°", Witness(plan, replace(mems, rate_share=3e-5, square=0.1))),
        ("table 1e-4", Witness(plan, replace(mems, rate_share=1e-4))),
        ("table 3e-4", Witness(plan, replace(mems, rate_share=3e-4))),
        ("table 1e-3", Witness(plan, replace(mems, rate_share=1e-3))),
        ("warming 0.1 °/s/min", Witness(plan, replace(mems, drift=0.1 / 60))),
        ("g-sensitivity 0.1 °/s/g", Witness(plan, replace(mems, g_sensitivity=0.1))),
        (
            "bridge.sim, flicker 0.014",
            Simulated(
                ALIGNED,
                both(TABLE),
                ImuSpec(noise_dps=0.07, bias_instability_dps=0.014, rrw_dps_per_sqrt_s=7e-4, misalignment_deg=0.5),
                25.0,
                8.0,
            ),
        ),
    ]
    told = [Case(f"table {name}", "turntable", TABLE, read) for name, read in found]
    others = [
        ("rate 30", (30.0,)),
        ("rates 5 10 20", (5.0, 10.0, 20.0)),
        ("rates 10 … 300", (10.0, 50.0, 100.0, 200.0, 300.0)),
    ]
    told += [
        Case(f"table {name}", "turntable", rates, Witness(replace(plan, rates=both(rates)), mems))
        for name, rates in others
    ]
    untold = Witness(replace(plan, rates=both((*TABLE, 45.0, 5.0))), mems)
    return [
        *told,
        Case("table also 45 and 5 °/s, not told", "turntable", TABLE, untold),
        *(
            Case(f"table wrong: told {told}", "turntable", told, Witness(brief, mems))
            for told in (
                (31.0, 57.0, 90.0),
                (10.0, 20.0, 30.0),
                (30.0, 60.0, 100.0),
                (30.0, 60.3, 90.0),
                (30.0, 45.0, 90.0),
            )
        ),
    ]


@dataclass(frozen=True)
class Found:
    """Of one recording; nees and off are NaN when there is no estimate."""

    accepted: bool
    wrong: bool
    nees: float
    off: float
    said: str


def calibrated(case: Case, seed: int) -> Found:
    """One recording, calibrated."""
    read = case.read(seed)
    samples = Samples(read.time, read.gyro, read.accel, np.zeros(len(read.time), bool))
    return judged(BY_RATES[case.method](samples, tuple(np.radians(case.rates)), WanderKnobs()), read.k)


def judged(result: Result, k: Floats) -> Found:
    """A result beside the truth."""
    accepted = result.verdict is Verdict.ACCEPTED
    if not np.isfinite(result.covariance).all():
        return Found(accepted, accepted, np.nan, np.nan, english(*result.reason))
    error, cov = result.scale - k, result.covariance[3:6, 3:6]
    wrong = np.abs(error) > np.maximum(0.01 * k, 4 * np.sqrt(np.diag(cov)))
    nees = float(error @ np.linalg.solve(cov, error)) / 3
    return Found(
        accepted, accepted and bool(wrong.any()), nees, float(np.abs(error / k).max()), english(*result.reason)
    )


def _calibrated(job: tuple[str, int]) -> Found:
    return calibrated(next(case for case in cases() if case.name == job[0]), job[1])


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.machines")
    parser.add_argument("--runs", type=int, default=60, help="recordings of each case")
    parser.add_argument("--only", default="", help="cases whose name has this word")
    given = parser.parse_args()
    print(f"{'case':40} {'accepted':>8} {'wrong':>6} {'NEES of k':>10} {'worst k, %':>11}  said")
    with ProcessPoolExecutor(2) as pool:
        for case in cases():
            if given.only not in case.name:
                continue
            found = list(pool.map(_calibrated, [(case.name, seed) for seed in range(given.runs)], chunksize=5))
            good = [one for one in found if one.accepted]
            said = next((one.said for one in found if not one.accepted), found[0].said)
            nees = f"{np.mean([one.nees for one in good]):.2f}" if good else "-"
            worst = f"{100 * max(one.off for one in good):.3f}" if good else "-"
            accepted, wrong = f"{len(good) / len(found):.1%}", sum(one.wrong for one in found)
            print(f"{case.name:40} {accepted:>8} {wrong:>6} {nees:>10} {worst:>11}  {said[:90]}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
