"""Runs of the simulation of Wang et al. 2024: Algorithm 1 and closure on the same sessions.

The errors are compared with the truth and the Cramér-Rao bound. The paper's gyro has a constant bias, and its hand puts
the device back exactly. The closure method is given both facts. Where the simulated hand has a re-placement error,
closure is given its size.
"""

from collections.abc import Sequence

import numpy as np
from msgspec import convert
from numpy.typing import NDArray

from bridge.sim.paper_sessions import PaperGyro, PaperPlan, draw_gyro, simulate
from estimator.calibration.closure import ClosureKnobs
from estimator.study import many
from estimator.study.study import Arrays, Job, Parts, Scenario, generator

METHODS = ("algorithm1", "closure")
WORDS = {"algorithm1": "Algorithm 1", "closure": "closure"}
PARAMETERS = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z")
#: sessions computed together: more would not fit into the processor's cache
CHUNK = 10
#: number of sessions in one job
TASK = 10 * CHUNK
_TO_PAPER = [3, 4, 5, 0, 1, 2]


def run(gyro: PaperGyro, plan: PaperPlan, sessions: int, rng: np.random.Generator) -> Arrays:
    """Simulate and calibrate n sessions of one gyro by Algorithm 1 and closure.

    Returns three arrays; parameters are in the order k_x, k_y, k_z (no unit), b_x, b_y, b_z (°/s):

        error   (2 methods, n, 6)   estimate minus truth
        nees    (n,)                of closure, 6 degrees of freedom
        bound   (m, 6)              Cramér-Rao variances of the first m sessions, as they hardly differ between sessions

    b here is the reading at rest, although the paper's b is minus that.
    """
    truth = np.concatenate([gyro.bias, gyro.k])
    unit = np.concatenate([np.full(3, 180 / np.pi), np.ones(3)])
    miss = np.radians(plan.replacement_deg)
    error, nees = [], []
    bound: NDArray[np.float64] = np.empty((0, 6))
    for start in range(0, sessions, CHUNK):
        of = simulate(gyro, plan, min(CHUNK, sessions - start), rng)
        coning = plan.rate_hz < ClosureKnobs().coning_below_hz
        paper, (ours, covariance) = many.algorithm1(of), many.closure(many.evidence(of, miss, coning=coning))
        off = ours - truth
        nees.append(np.einsum("si,si->s", off, np.linalg.solve(covariance, off[..., None])[..., 0]))
        if start == 0:
            bound = many.bound(of, np.radians(plan.noise_dps), miss)
        error.append(unit * (np.stack([paper, ours]) - truth))
    return {
        "error": np.concatenate(error, axis=1)[..., _TO_PAPER],
        "bound": (unit**2 * bound)[:, _TO_PAPER],
        "nees": np.concatenate(nees),
    }


def joined(parts: list[Arrays]) -> Arrays:
    """Join the results of several calls of `run` along the sessions: arrays error, nees and bound, in the same units."""
    return {
        "error": np.concatenate([part["error"] for part in parts], axis=1),
        "bound": np.concatenate([part["bound"] for part in parts]),
        "nees": np.concatenate([part["nees"] for part in parts]),
    }


class Simulation(Scenario, frozen=True, kw_only=True):
    """Scenario of the paper's simulation: `runs` sessions at each noise.

    sets: number of random gyros (scale factors and bias) among which the sessions are divided.
    Noise in °/s per reading, sample rate in Hz, lengths of rests and turns in s. turn_s: shortest and longest turn.
    """

    sets: int
    noise_dps: tuple[float, ...]
    rate_hz: float
    rest_s: float
    turn_s: tuple[float, float]


def inputs(scenario: Simulation) -> Simulation:
    """Reduce a scenario to the values on which its runs depend, such as noise, sample rate and seed.

    The result is equal for all studies of the same runs, so that they share computed arrays.
    """
    return convert(scenario, Simulation, from_attributes=True)


def jobs(of: Simulation) -> Sequence[Job]:
    """Jobs of a scenario, each a part of the sessions that one process computes.

    Each is (noise in °/s, number of the gyro, first run, last run + 1).
    """
    runs = {number: of.runs // of.sets + (number < of.runs % of.sets) for number in range(of.sets)}
    return [
        (noise, number, first, min(first + TASK, runs[number]))
        for noise in of.noise_dps
        for number in range(of.sets)
        for first in range(0, runs[number], TASK)
    ]


def work(of: Simulation, job: Job) -> Arrays:
    """Simulate and calibrate the sessions of one job, of one gyro at one noise; return the arrays of `run`."""
    noise, number, first, last = (float(word) for word in job)
    plan = PaperPlan(noise, rest_s=of.rest_s, turn_s=of.turn_s, rate_hz=of.rate_hz)
    return run(gyro_of(of.seed, int(number)), plan, int(last - first), generator(of.seed, noise, number, first))


def gyro_of(seed: int, number: int) -> PaperGyro:
    """Simulated gyro with random scale factors and bias, by its number from 0; the same at every noise."""
    return draw_gyro(np.random.default_rng((seed, number)))


def at_noise(parts: Parts, noise: float) -> dict[Job, Arrays]:
    """Select the results of all jobs with one noise (°/s); keys are the jobs, values the arrays of `run`."""
    return {job: part for job, part in parts.items() if job[0] == noise}
