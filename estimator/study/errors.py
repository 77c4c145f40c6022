"""Figure 7 of Wang et al. 2024: signed errors of bias and scale over thousands of simulated sessions, by parameter."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from rich.console import RenderableType

from bridge.terminal.tables import Column, Columns
from estimator.study import simulation
from estimator.study.simulation import METHODS, PARAMETERS, WORDS, Simulation
from estimator.study.spread import Spread, holds, spread
from estimator.study.study import Finding, Parts, Study


class ErrorsScenario(Simulation, frozen=True, kw_only=True):
    """Scenario of study `errors`.

    paper_band: for each noise, the limit within which the paper has most errors. It applies to scale factors (no unit)
        and bias (°/s).
    Raises ValueError when the numbers of bands and noises differ.
    """

    paper_band: tuple[float, ...]

    def __post_init__(self) -> None:
        Simulation.__post_init__(self)
        if len(self.paper_band) != len(self.noise_dps):
            raise ValueError(
                f"paper_band has {len(self.paper_band)} numbers, but noise_dps has {len(self.noise_dps)}: give "
                "the same number of values for both"
            )


class Row(Struct, frozen=True):
    """Errors of one parameter by one method at one noise (°/s per reading).

    Errors and bounds of the scale factors k have no unit, those of the bias b are in °/s.
    bound: root of the Cramér-Rao variance. paper_band: limit within which the paper has most errors. inside: fraction
        of errors within this limit.
    """

    noise_dps: float
    method: str
    parameter: str
    error: Spread
    bound: float
    paper_band: float
    inside: float


class Honesty(Struct, frozen=True):
    """Consistency of closure's covariance at one noise (°/s per reading).

    nees: mean NEES of scale factors and bias per degree of freedom (6); 1 for a consistent covariance.
    band: half width of the 95 % interval about 1 that chance leaves to a consistent covariance.
    """

    noise_dps: float
    nees: float
    band: float


class Errors(Struct, frozen=True):
    """Results of the study: errors by parameter, method and noise (°/s), and consistency of closure's covariance by noise."""

    rows: list[Row]
    honesty: list[Honesty]

    def of(self, noise: float, method: str) -> list[Row]:
        """Six rows, one per parameter (3 scale factors, 3 biases), of one method at one noise, °/s."""
        return [row for row in self.rows if (row.noise_dps, row.method) == (noise, method)]


def results(scenario: ErrorsScenario, parts: Parts) -> Errors:
    """Compute the spread of each parameter's errors by noise and method, and the NEES of closure, from all runs.

    Errors of the scale factors k have no unit, those of the bias b are in °/s.
    """
    rows, honesty = [], []
    for noise, band in zip(scenario.noise_dps, scenario.paper_band, strict=True):
        found = simulation.joined(list(simulation.at_noise(parts, noise).values()))
        bound = np.sqrt(found["bound"].mean(axis=0))
        for error, method in zip(found["error"], METHODS, strict=True):
            rows += [
                Row(noise, method, name, spread(e), float(least), band, float(np.mean(np.abs(e) <= band)))
                for name, e, least in zip(PARAMETERS, error.T, bound, strict=True)
            ]
        nees = found["nees"]
        honesty.append(Honesty(noise, float(nees.mean() / 6), float(1.96 * np.sqrt(2 / (6 * len(nees))))))
    return Errors(rows, honesty)


def tables(found: Errors) -> Sequence[RenderableType]:
    """Build a table of the errors (k without unit, b in °/s) with a row per parameter, noise and method; and the NEES."""
    headings = {
        "°/s": 0,
        "method": 0,
        "of": 0,
        "median": 0,
        "mean": 0,
        "95 % within": 2,
        "rms": 0,
        "bound": 1,
        "in band": 0,
    }
    title = f"Errors in {found.rows[0].error.n:,} simulated sessions at each noise (k; b in °/s); ±: 95 % interval"
    table = Columns([Column(name, number=True, spare=spare) for name, spare in headings.items()], title=title)
    for row in found.rows:
        e = row.error
        table.add(
            f"{row.noise_dps:g}",
            WORDS[row.method],
            row.parameter,
            f"{e.median:+.1e} ± {(e.median_ci[1] - e.median_ci[0]) / 2:.0e}",
            f"{e.mean:+.1e} ± {(e.mean_ci[1] - e.mean_ci[0]) / 2:.0e}",
            f"±{max(map(abs, e.band)):.1e}",
            f"{e.rms:.1e}",
            f"{row.bound:.1e}",
            f"{100 * row.inside:.1f}%",
        )
    honest = ", ".join(f"{one.nees:.3f} ± {one.band:.3f} at {one.noise_dps:g} °/s" for one in found.honesty)
    return table, f"closure's NEES per degree of freedom (expected: 1): {honest}"


def findings(found: Errors) -> Sequence[Finding]:
    """Judge figure 7 of Wang et al. 2024: errors without bias, most of them within the paper's band."""
    rows = [row for row in found.rows if row.method == "algorithm1"]
    zero = sum(holds(row.error.median_ci, 0.0) for row in rows)
    least = min(row.inside for row in rows)
    odd = max(abs(row.error.median) / row.error.rms for row in rows)
    ours = f"{zero} of {len(rows)} medians hold zero in their 95 % interval; {100 * least:.1f} % or more in the band"
    # Of twelve honest 95 % intervals ten or more contain the truth in 98 of 100 studies.
    unbiased = zero >= 0.8 * len(rows) or odd < 0.05
    k = max(abs(row.error.band[1]) for row in rows if row.parameter.startswith("k"))
    return (
        Finding(
            "errors",
            ours,
            "agrees" if unbiased and least > 0.5 else "agrees in part" if unbiased or least > 0.5 else "differs",
            f"the bands are those of the bias in °/s; k is within ±{k:.1g}",
        ),
    )


STUDY = Study(
    "errors",
    ErrorsScenario,
    results,
    tables,
    findings,
    inputs=simulation.inputs,
    jobs=simulation.jobs,
    work=simulation.work,
)
