"""Error analysis: effect of each cause (noise, rate, hand, times) on the scale factor, compared with the Cramér-Rao bound.

The causes are varied one at a time about the simulation of Wang et al. 2024, for Algorithm 1 and for closure.
"""

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from msgspec import Struct
from rich.console import RenderableType

from bridge.sim.paper_sessions import PaperPlan
from bridge.terminal.tables import Column, Columns
from estimator.study import simulation
from estimator.study.simulation import METHODS
from estimator.study.study import Arrays, Finding, Job, Parts, Scenario, Study, generator

Sampling = Literal["mean", "point"]
Key = Literal["noise_dps", "rate_hz", "wobble_deg", "replacement_deg", "turn_s", "rest_s", "session_s"]


class Factor(Struct, frozen=True, forbid_unknown_fields=True):
    """Cause of an error whose size the study varies: its values, and other differences of the sessions from `Base`.

    key: quantity that is varied; its suffix is the unit of the values. label: axis label in the figure.
    Key `rate_hz` keeps the noise density constant, so the noise of a sample grows with the root of the rate. Key
    `session_s` is the length of a session; rests and turns are scaled together.
    wobble_deg: wobble of the hand, degrees. sampling: `mean` for sensors that average over a sample interval, `point`
        for sensors that read at one instant.
    log: True for a logarithmic axis in the figure.
    """

    name: str
    key: Key
    label: str
    values: tuple[float, ...]
    wobble_deg: float = 0.0
    sampling: tuple[Sampling, ...] = ("mean",)
    log: bool = True


class Base(Struct, frozen=True, forbid_unknown_fields=True):
    """Values where a cause is not varied: noise (°/s), sample rate (Hz), and lengths of rests and turns (s)."""

    noise_dps: float
    rate_hz: float
    rest_s: float
    turn_s: float


class AnalysisScenario(Scenario, frozen=True, kw_only=True):
    """Scenario of study `analysis`: `runs` sessions for each value of each factor.

    sets: number of random gyros (scale factors and bias) among which the sessions are divided.
    """

    sets: int
    base: Base
    factors: tuple[Factor, ...]


class Row(Struct, frozen=True):
    """Results for one value of a cause and one method, over all sessions.

    k_rms, b_rms: rms errors of the scale factors k (no unit) and the bias b (°/s).
    k_mean, k_mean_ci: mean error of k, and half the width of its 95 % interval.
    k_bound, b_bound: rms Cramér-Rao bounds, in the same units.
    nees: mean normalised estimation error squared of closure, per degree of freedom; None for Algorithm 1.
    """

    factor: str
    value: float
    sampling: Sampling
    method: str
    k_rms: float
    b_rms: float
    k_mean: float
    k_mean_ci: float
    k_bound: float
    b_bound: float
    nees: float | None


class Analysis(Struct, frozen=True):
    """Results of the study: all rows, the factors, the values not varied, and the number of sessions for each value."""

    runs: int
    factors: tuple[Factor, ...]
    base: Base
    rows: list[Row]

    def of(self, factor: str, method: str, sampling: str = "mean") -> list[Row]:
        """Rows of one factor for one method (`algorithm1` or `closure`), in the order of the factor's values.

        sampling: `mean` or `point`, as in Factor.
        """
        return [r for r in self.rows if (r.factor, r.method, r.sampling) == (factor, method, sampling)]


def jobs(of: AnalysisScenario) -> Sequence[Job]:
    """Jobs (factor, value, sampling) of the study, highest sample rates first, as they take longest."""
    found: list[Job] = [(f.name, value, how) for f in of.factors for value in f.values for how in f.sampling]
    keys = {f.name: f.key for f in of.factors}
    return sorted(found, key=lambda job: -float(job[1]) if keys[str(job[0])] == "rate_hz" else 0.0)


def plan_of(of: AnalysisScenario, job: Job) -> PaperPlan:
    """Session plan of one job: rests, turns, noise and sample rate of `Base`, with the job's value of its factor.

    job: (factor, value, sampling), as in `jobs`. Turns last from 0.8 to 1.2 of the plan's turn length (s).
    """
    factor = next(f for f in of.factors if f.name == job[0])
    base, value = of.base, float(job[1])
    varied = msgspec.structs.asdict(base) | {"wobble_deg": factor.wobble_deg, "replacement_deg": 0.0}
    if factor.key == "rate_hz":
        varied |= {"rate_hz": value, "noise_dps": base.noise_dps * (value / base.rate_hz) ** 0.5}
    elif factor.key == "session_s":
        longer = value / (4 * base.rest_s + 3 * base.turn_s)
        varied |= {"rest_s": longer * base.rest_s, "turn_s": longer * base.turn_s}
    else:
        varied |= {factor.key: value}
    turn_s = varied.pop("turn_s")
    sampling: Sampling = "point" if job[2] == "point" else "mean"
    return PaperPlan(**varied, turn_s=(0.8 * turn_s, 1.2 * turn_s), sampling=sampling)


def work(of: AnalysisScenario, job: Job) -> Arrays:
    """Simulate and calibrate the sessions of one job; return errors, NEES and bounds, as `simulation.run` does."""
    plan = plan_of(of, job)
    counts = [of.runs // of.sets + (number < of.runs % of.sets) for number in range(of.sets)]
    # Equal random numbers for each value of a factor, as far as possible: only the factor makes the difference.
    return simulation.joined(
        [
            simulation.run(simulation.gyro_of(of.seed, number), plan, count, generator(of.seed, str(job[0]), number))
            for number, count in enumerate(counts)
            if count
        ]
    )


def results(of: AnalysisScenario, parts: Parts) -> Analysis:
    """Compute rms errors, bounds and NEES for each factor, value and method from the arrays of all jobs.

    Errors of the scale factors k have no unit, those of the bias b are in °/s.
    """
    rows = []
    for factor in of.factors:
        for how in factor.sampling:
            for value in factor.values:
                rows += _rows(factor.name, value, how, parts[factor.name, value, how])
    return Analysis(of.runs, of.factors, of.base, rows)


def _rows(factor: str, value: float, how: Sampling, part: Arrays) -> list[Row]:
    bound = part["bound"].mean(axis=0)
    rows = []
    for error, method in zip(part["error"], METHODS, strict=True):
        k, b = error[:, :3], error[:, 3:]
        rows.append(
            Row(
                factor=factor,
                value=value,
                sampling=how,
                method=method,
                k_rms=float(np.sqrt(np.mean(k**2))),
                b_rms=float(np.sqrt(np.mean(b**2))),
                k_mean=float(k.mean()),
                k_mean_ci=float(1.96 * k.std() / np.sqrt(k.size)),
                k_bound=float(np.sqrt(bound[:3].mean())),
                b_bound=float(np.sqrt(bound[3:].mean())),
                nees=float(part["nees"].mean() / 6) if method == "closure" else None,
            )
        )
    return rows


def tables(found: Analysis) -> Sequence[RenderableType]:
    """Build one table of the rms error of the scale factors k (no unit), with a row for each value of each factor."""
    names = {"cause": 0, "value": 0, "samples": 3, "Algorithm 1": 0, "closure": 0, "bound": 0, "NEES": 2}
    table = Columns(
        [Column(name, number=name not in ("cause", "samples"), spare=spare) for name, spare in names.items()],
        title=f"Rms error of k, {found.runs} simulated sessions each",
    )
    for factor in found.factors:
        for how in factor.sampling:
            pairs = zip(*(found.of(factor.name, method, how) for method in METHODS), strict=True)
            for paper, ours in pairs:
                table.add(
                    factor.name, f"{paper.value:g}", how, f"{paper.k_rms:.1e}", f"{ours.k_rms:.1e}",
                    f"{ours.k_bound:.1e}", f"{ours.nees:.2f}",
                )  # fmt: skip
    return (table,)


def findings(found: Analysis) -> Sequence[Finding]:
    """Judge the claims of Wang et al. 2024 on noise, discretization and hand motion, from the results of the study."""
    return _of_noise(found.of("noise", "algorithm1")), _of_rate(found), _of_hand(found)


def _of_noise(rows: Sequence[Row]) -> Finding:
    first, last = rows[0], rows[-1]
    power = float(np.log(last.k_rms / first.k_rms) / np.log(last.value / first.value))
    seen = abs(last.k_mean) > 1.5 * last.k_mean_ci
    return Finding(
        "noise",
        f"rms error of k {first.k_rms:.0e} to {last.k_rms:.0e} for {first.value:g} to {last.value:g} °/s "
        f"(noise to the power {power:.2f}); bias {last.k_mean:+.0e} ± {last.k_mean_ci:.0e} at most",
        "agrees" if seen and power > 0 else "agrees in part" if power > 0.5 else "differs",
        "" if seen else "the error grows with noise; no bias differs significantly from zero",
    )


def _of_rate(found: Analysis) -> Finding:
    said, falls = [], False
    averaging = found.of("sampling rate, fixed axis", "closure", "mean")
    for hand in ("fixed axis", "wobble 3°"):
        rows = found.of(f"sampling rate, {hand}", "closure", "point")
        slow, fast = rows[0], rows[-1]
        said.append(f"{hand}: {slow.k_rms:.0e} at {slow.value:g} Hz, {fast.k_rms:.0e} at {fast.value:g} Hz")
        falls = falls or slow.k_rms > 1.5 * fast.k_rms
    return Finding(
        "discretization",
        "; ".join(said) + " (closure, sensor that samples points)",
        "agrees" if falls else "differs",
        f"a sensor that averages, fixed axis: {averaging[0].k_rms:.0e} and {averaging[-1].k_rms:.0e}",
    )


def _of_hand(found: Analysis) -> Finding:
    def at(factor: str, value: float) -> float:
        return next(row.k_rms for row in found.of(factor, "algorithm1") if row.value == value)

    speed = max(row.k_rms for row in found.of("turn time", "algorithm1"))
    wobble, miss = at("hand wobble", 3.0), at("re-placement", 0.2)
    return Finding(
        "physical",
        f"rms error of k, Algorithm 1: wobble 3° {wobble:.1e}, re-placement 0.2° {miss:.1e}, turn speed {speed:.0e} at most",
        "agrees" if max(wobble, miss, speed) < 1e-2 else "differs",
        f"noise alone leaves {at('hand wobble', 0.0):.0e}",
    )


STUDY = Study("analysis", AnalysisScenario, results, tables, findings, jobs=jobs, work=work)
