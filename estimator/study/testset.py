"""Figure 8 of Wang et al. 2024: mean error of the rate on a test set, before and after calibration (equation 12)."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from rich.console import RenderableType

from bridge.terminal.tables import Column, Columns
from estimator.study import simulation
from estimator.study.simulation import METHODS, WORDS, Simulation
from estimator.study.spread import Spread, spread
from estimator.study.study import Finding, Parts, Study, generator

BEFORE = "before"
AXES = ("x", "y", "z")


class TestsetScenario(Simulation, frozen=True, kw_only=True):
    """Scenario of study `testset`: the test set has test_samples samples of a constant rate, equal on the three axes.

    test_rate_dps: magnitude of the rate, °/s.
    paper_left: fraction of the error that remains in the paper, at the noise paper_left_noise_dps (°/s).
    """

    __test__ = False

    test_rate_dps: float
    test_samples: int
    paper_left: float
    paper_left_noise_dps: float


class Row(Struct, frozen=True):
    """Spread over the runs of the mean error e (equation 12 of the paper) of one axis, °/s, at one noise, °/s per reading.

    stage: `before` calibration, or the method.
    """

    noise_dps: float
    stage: str
    axis: str
    error: Spread


class Left(Struct, frozen=True):
    """Fraction of the test set's error that remains after calibration by one method, no unit.

    noise_dps: noise of a reading, °/s.
    rms: rms error after calibration over rms error before, of all runs and axes.
    median, most: median and 97.5 % quantile of the runs' fractions.
    """

    noise_dps: float
    method: str
    rms: float
    median: float
    most: float


class Testset(Struct, frozen=True):
    """Results of the study: rows of mean errors (°/s), fractions left after calibration, and the paper's fraction."""

    __test__ = False

    rows: list[Row]
    left: list[Left]
    paper_left: float
    paper_left_noise_dps: float

    def of(self, noise: float, stage: str) -> list[Row]:
        """Rows of the three axes at one noise (°/s) and stage: `before` calibration, or the method."""
        return [row for row in self.rows if (row.noise_dps, row.stage) == (noise, stage)]


def results(scenario: TestsetScenario, parts: Parts) -> Testset:
    """Compute the mean errors of the rate, °/s, on a test set of each run, before and after calibration.

    The test set has its own noise.
    """
    rows, left = [], []
    for noise in scenario.noise_dps:
        before, after = [], []
        for job, part in simulation.at_noise(parts, noise).items():
            rng = generator(scenario.seed, "test", *job)
            raw, corrected = mean_errors(scenario, noise, int(job[1]), part["error"], rng)
            before.append(raw)
            after.append(corrected)
        raw, corrected = np.concatenate(before), np.concatenate(after, axis=1)
        for stage, e in zip((BEFORE, *METHODS), (raw, *corrected), strict=True):
            rows += [Row(noise, stage, axis, spread(e[:, i])) for i, axis in enumerate(AXES)]
        for method, e in zip(METHODS, corrected, strict=True):
            share = np.linalg.norm(e, axis=1) / np.linalg.norm(raw, axis=1)
            rms = float(np.sqrt(np.mean(e**2) / np.mean(raw**2)))
            left.append(Left(noise, method, rms, float(np.median(share)), float(np.quantile(share, 0.975))))
    return Testset(rows, left, scenario.paper_left, scenario.paper_left_noise_dps)


def mean_errors(
    scenario: TestsetScenario, noise: float, number: int, error: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean errors (true rate minus measured) of the test set, °/s: of n readings (n, 3), and of corrected rates (2, n, 3).

    noise: standard deviation of one sample, °/s. number: number of the simulated gyro, as for `simulation.gyro_of`.
    error (2, n, 6): calibration errors by method, in the order k_x, k_y, k_z (scale factors, no unit), b_x, b_y, b_z
        (bias, °/s).
    The n values belong to n calibrations of the same gyro.
    """
    gyro = simulation.gyro_of(scenario.seed, number)
    rate = scenario.test_rate_dps / np.sqrt(3)
    mean_noise = noise / np.sqrt(scenario.test_samples) * rng.standard_normal((error.shape[1], 3))
    reading = rate / gyro.k + np.degrees(gyro.bias) + mean_noise
    k, bias = gyro.k + error[..., :3], np.degrees(gyro.bias) + error[..., 3:]
    return rate - reading, rate - k * (reading - bias)


def tables(found: Testset) -> Sequence[RenderableType]:
    """Build a table of mean errors, °/s, one row per axis, and a table of the fractions left after calibration."""
    names = {BEFORE: "before", **WORDS}
    n = found.rows[0].error.n
    table = Columns(
        [Column(name, number=True) for name in ("°/s", "calibration", "axis", "median", "middle half", "rms")],
        title=f"Mean error of the rate on a test set, °/s, {n:,} simulated sessions at each noise",
    )
    for row in found.rows:
        e = row.error
        half = f"{e.quartiles[0]:+.4f} … {e.quartiles[1]:+.4f}"
        table.add(f"{row.noise_dps:g}", names[row.stage], row.axis, f"{e.median:+.4f}", half, f"{e.rms:.4f}")
    share = Columns(
        [Column(name, number=True) for name in ("°/s", "calibration", "rms", "median run", "97.5 % of runs")],
        title="What is left of the error",
    )
    for one in found.left:
        share.add(
            f"{one.noise_dps:g}", WORDS[one.method], *(f"{100 * x:.3f}%" for x in (one.rms, one.median, one.most))
        )
    return table, share


def findings(found: Testset) -> Sequence[Finding]:
    """Judge figure 8 of Wang et al. 2024: calibration reduces the error of the rate to 3 % or less."""
    left = next(one for one in found.left if one.method == "algorithm1" and one.noise_dps == found.paper_left_noise_dps)
    return (
        Finding(
            "testset",
            f"{100 * left.rms:.2g} % of before (rms); {100 * left.most:.2g} % or less in 97.5 % of runs",
            "agrees" if left.rms <= found.paper_left else "differs",
            "less error is left than the paper states; the paper gives no test rate"
            if left.rms < found.paper_left / 3
            else "",
        ),
    )


STUDY = Study(
    "testset",
    TestsetScenario,
    results,
    tables,
    findings,
    inputs=simulation.inputs,
    jobs=simulation.jobs,
    work=simulation.work,
)
