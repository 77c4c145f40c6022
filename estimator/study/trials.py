"""Trials of study `sensors`: sessions of the paper's two sensors, simulated one by one and calibrated by each method.

The turntable column of Wang et al. 2024 is the truth. The bias wanders by the device's noise model, so the errors of b
include the wander between two calibrations, as in the paper.
"""

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from bridge.sim.motion import GRAVITY, Piece
from bridge.wire.messages import Verdict
from estimator.offline import recordings
from estimator.study.device import Hand, WithSensors, load_device, record
from estimator.study.sessions import AccelAided, Servomotor, Turntable
from estimator.study.study import Arrays, Job, Scenario, generator

METHODS = ("turn360", "closure", "turntable", "accel_aided", "servomotor")
WORDS = {
    "turn360": "Algorithm 1",
    "closure": "closure",
    "turntable": "turntable",
    "accel_aided": "accel-aided",
    "servomotor": "servomotor",
}
_TASK = 5


class SensorsScenario(Scenario, frozen=True, kw_only=True):
    """Scenario of study `sensors`: names in configs/study/sensors, the motion of each method, and the paper's limits.

    paper_limit: by sensor, the largest error in the paper of scale factors (no unit) and bias (°/s).
    """

    sensors: tuple[str, ...]
    hand: Hand
    turntable: Turntable
    accel_aided: AccelAided
    servomotor: Servomotor
    paper_limit: dict[str, float]


Inputs = WithSensors[SensorsScenario]


def inputs(scenario: SensorsScenario) -> Inputs:
    """Read the files of a scenario's sensors. Raises ConfigError for an unknown sensor or an invalid file."""
    return WithSensors(scenario, {name: load_device(name) for name in scenario.sensors})


def jobs(of: Inputs) -> Sequence[Job]:
    """Jobs (sensor, method, first run, last run + 1) of a scenario, the longest first."""
    methods = sorted(METHODS, key=lambda method: method not in ("turntable", "accel_aided"))
    return [
        (name, method, first, min(first + _TASK, of.scenario.runs))
        for method in methods
        for name in of.devices
        for first in range(0, of.scenario.runs, _TASK)
    ]


def work(of: Inputs, job: Job) -> Arrays:
    """Run one job: simulate and calibrate n sessions of one sensor by one method.

    Returns five arrays:

        found      (n, 6)   estimates k_x, k_y, k_z (no unit), and b_x, b_y, b_z (°/s, the paper's sign)
        std        (n, 6)   their standard deviations, in the same units
        accepted   (n,)     True for verdict ACCEPTED
        lasts      (n,)     duration of the session, s
        took       (n,)     computing time, s
    """
    name, method, first, last = str(job[0]), str(job[1]), int(job[2]), int(job[3])
    found, std, accepted, lasts, took = [], [], [], [], []
    for number in range(first, last):
        # Both methods by hand get the same device and motion.
        rng = generator(of.scenario.seed, name, "hand" if method in ("turn360", "closure") else method, number)
        pieces, rates, accel, zero_g = session_of(of.scenario, method, rng)
        recorded = record(of.devices[name], pieces, rng, zero_g=zero_g)
        recording = recorded.until(np.inf, accel=accel)
        begun = perf_counter()
        result, _ = recordings.calibrate(recording, method, recording.gyro_range, tuple(np.radians(rates)))
        took.append(perf_counter() - begun)
        variance = np.diag(result.covariance)
        found.append([*result.scale, *-np.degrees(result.bias)])
        std.append([*np.sqrt(variance[3:6]), *np.degrees(np.sqrt(variance[:3]))])
        accepted.append(result.verdict is Verdict.ACCEPTED)
        lasts.append(recorded.ends_s[-1])
    return {
        "found": np.array(found),
        "std": np.array(std),
        "accepted": np.array(accepted),
        "lasts": np.array(lasts),
        "took": np.array(took),
    }


def session_of(
    of: SensorsScenario, method: str, rng: np.random.Generator
) -> tuple[Sequence[Piece], tuple[float, ...], bool, float | None]:
    """Create a random session of a method: its motion, and the information that the calibration is given.

    Returns four values: pieces of motion; known rates of the machine (°/s); True if the accelerometer is used; and ±
    limit of the accelerometer's offset (m/s²). The limit is None for the device's own.
    """
    if method == "turntable":
        return of.turntable.pieces(rng), of.turntable.rates_dps, False, None
    if method == "servomotor":
        servo = of.servomotor
        return servo.pieces(rng), (servo.rate_dps,), True, servo.accel_offset_mg * GRAVITY / 1e3
    if method == "accel_aided":
        return of.accel_aided.pieces(rng), (), True, None
    return of.hand.pieces(rng), (), False, None
