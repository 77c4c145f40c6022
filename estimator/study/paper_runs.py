"""The runs behind the paper's simulation, spread over processes: scenario in, errors out. Imports nothing that draws."""

import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.sim.paper import PaperPlan, draw_gyro, simulate
from estimator.study import many
from estimator.study.interrupts import unheard

Floats = NDArray[np.float64]
#: shows how far it is: takes what is done, one after the other, and how many there will be
Progress = Callable[[Iterable[Any], int], Iterable[Any]]
SETS = 30
#: sessions computed together: more of them leave the processor's cache
CHUNK = 10
#: sessions in one message between processes
TASK = 5 * CHUNK

#: rad/s about each axis that the test set reaches: the paper's full-scale range
TEST_RATE = np.radians(245.0)


@dataclass(frozen=True, slots=True)
class Scenario:
    """What is studied: sessions at each noise, °/s, with what hand, degrees, from what seed."""

    runs: int = 15_000
    noise_dps: tuple[float, ...] = (0.03, 0.15)
    wobble_deg: float = 0.0
    replacement_deg: float = 0.0
    seed: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Of n runs: error (2 methods, n, 6) in bias °/s and k; nees (n,) of closure; bound (m, 6) variances of some of them.

    The bound hardly differs from run to run of one parameter set: some of each set are enough. test (2, n): rms error of
    corrected rates over that of readings, on a test set of rates and noise.
    """

    error: Floats
    bound: Floats
    nees: Floats
    test: Floats


def compute(scenario: Scenario, workers: int | None = None, progress: Progress | None = None) -> dict[float, Errors]:
    """The errors at each noise; the same for any number of workers (default: one a processor)."""
    tasks = [
        (scenario, noise, number, first)
        for noise in scenario.noise_dps
        for number in range(SETS)
        for first in range(0, _runs_of(scenario, number), TASK)
    ]
    # Started anew and not copied: a copy of a process with threads may hang.
    with unheard():
        started = multiprocessing.get_context("spawn").Pool(workers)
    with started as pool:
        done: Iterable[Any] = pool.imap_unordered(_placed, tasks)
        parts = dict(progress(done, len(tasks)) if progress else done)
    return {noise: _joined([parts[key] for key in sorted(parts) if key[0] == noise]) for noise in scenario.noise_dps}


def _runs_of(scenario: Scenario, number: int) -> int:
    return scenario.runs // SETS + (number < scenario.runs % SETS)


def _placed(task: tuple[Scenario, float, int, int]) -> tuple[tuple[float, int, int], Errors]:
    return task[1:], _some(*task)


def _some(scenario: Scenario, noise_dps: float, number: int, first: int) -> Errors:
    """Runs of one parameter set from `first` on."""
    gyro = draw_gyro(np.random.default_rng((scenario.seed, number)))
    rng = np.random.default_rng((scenario.seed, number, first, round(noise_dps * 1e6)))
    plan = PaperPlan(noise_dps, scenario.wobble_deg, scenario.replacement_deg)
    truth = np.concatenate([gyro.bias, gyro.k])
    unit = np.concatenate([np.full(3, 180 / np.pi), np.ones(3)])
    replacement = np.radians(scenario.replacement_deg)
    parts = []
    last = min(first + TASK, _runs_of(scenario, number))
    for start in range(first, last, CHUNK):
        sessions = simulate(gyro, plan, min(CHUNK, last - start), rng)
        paper, ours = many.algorithm1(sessions), many.closure(many.evidence(sessions, replacement))
        error = ours.theta - truth
        nees = np.einsum("si,si->s", error, np.linalg.solve(ours.covariance, error[..., None])[..., 0])
        bound = many.bound(sessions, np.radians(noise_dps), replacement) if first == 0 else np.empty((0, 6))
        both = np.stack([paper.theta, ours.theta])
        test = remaining_error(both, truth, np.radians(noise_dps))
        parts.append(Errors(unit * (both - truth), unit**2 * bound, nees, test))
    return _joined(parts)


def remaining_error(theta: Floats, truth: Floats, noise: float) -> Floats:
    """(…,) rms error of corrected rates over that of the readings themselves, for parameters theta (…, 6) against truth (6,).

    Expected over a test set of rates, uniform within ±TEST_RATE about each axis, read with white noise (rad/s).
    """
    b, k = truth[:3], truth[3:]
    bias, scale = theta[..., :3], theta[..., 3:]
    rate_var = TEST_RATE**2 / 3
    left = rate_var * (scale / k - 1) ** 2 + scale**2 * ((bias - b) ** 2 + noise**2)
    raw = rate_var * (1 / k - 1) ** 2 + b**2 + noise**2
    return np.asarray(np.sqrt(left.sum(axis=-1) / raw.sum()))


def _joined(parts: Sequence[Errors]) -> Errors:
    return Errors(
        np.concatenate([part.error for part in parts], axis=1),
        np.concatenate([part.bound for part in parts]),
        np.concatenate([part.nees for part in parts]),
        np.concatenate([part.test for part in parts], axis=1),
    )
