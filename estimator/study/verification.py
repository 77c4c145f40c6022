"""Simulation of a sensor calibrated by hand, then turned by a machine, for figures 2, 9 and 10 of Wang et al. 2024."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import machine
from estimator.offline import recordings
from estimator.study.device import Hand, Recorded, WithSensors, load_device, record
from estimator.study.sessions import turn_s
from estimator.study.study import Floats, Job, Scenario, generator

METHODS = ("turn360", "closure")
WORDS = {"raw": "readings", "turn360": "Algorithm 1", "closure": "closure", "paper": "the paper's K and b"}


class VerificationScenario(Scenario, frozen=True, kw_only=True):
    """Scenario of figures 2, 9 and 10 of Wang et al. 2024.

    sensors: names in configs/study/sensors. hand: motion of the calibration.
    rate_dps: rate of the machine, °/s. rest_s: rest between its turns, s.
    """

    sensors: tuple[str, ...]
    hand: Hand
    rate_dps: float
    rest_s: float


Inputs = WithSensors[VerificationScenario]


def inputs(scenario: VerificationScenario) -> Inputs:
    """Read the files of a scenario's sensors. Raises ConfigError for an unknown sensor or an invalid file."""
    return WithSensors(scenario, {name: load_device(name) for name in scenario.sensors})


def jobs(of: Inputs) -> Sequence[Job]:
    """Jobs (sensor, number of the run) of a scenario."""
    return [(name, run) for name in of.devices for run in range(of.scenario.runs)]


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """Machine turns of a session after its calibration by hand: true, read and corrected rates over time.

    time_s (n,): time from the start of the machine part, s. truth (n, 3): true rate, rad/s.
    rates: arrays (n, 3), rad/s, by name: `raw` for readings, `turn360`, `closure` and `paper` for corrected rates.
    spins: start and end of each turn with its ramps, on the scale of time_s, s.
    """

    time_s: Floats
    truth: Floats
    rates: dict[str, Floats]
    spins: list[tuple[float, float]]


def verify(of: Inputs, job: Job) -> Verification:
    """Simulate one session in one boot: calibration by hand, then each axis turned 360° one way and back.

    job: (sensor, number of the run).
    """
    s, device = of.scenario, of.devices[str(job[0])]
    rng = generator(s.seed, *job)
    by_hand = s.hand.pieces(rng)
    turning = machine(np.eye(3), (-s.rate_dps, s.rate_dps), rest_s=s.rest_s, spin_s=turn_s(s.rate_dps))
    recorded = record(device, [*by_hand, *turning], rng)
    calibrated_s = float(recorded.ends_s[len(by_hand) - 1])
    session = recorded.until(calibrated_s)
    found = {method: recordings.calibrate(session, method, session.gyro_range)[0] for method in METHODS}
    after = recorded.recording.time_s > calibrated_s
    reading = recorded.recording.gyro[after]
    column = device.paper["turn360"]
    return Verification(
        time_s=recorded.recording.time_s[after] - calibrated_s,
        truth=recorded.rate[after],
        rates={
            "raw": reading,
            **{method: result.scale * (reading - result.bias) for method, result in found.items()},
            "paper": np.array(column.k) * (reading + np.radians(column.b_dps)),
        },
        spins=_spins([*by_hand, *turning], recorded, len(by_hand)),
    )


def _spins(pieces: Sequence[Piece], recorded: Recorded, first: int) -> list[tuple[float, float]]:
    """Start and end of the machine's turns, s: its moving pieces longer than 2 s."""
    begins = np.concatenate([[0.0], recorded.ends_s[:-1]]) - recorded.ends_s[first - 1]
    ends = recorded.ends_s - recorded.ends_s[first - 1]
    return [
        (float(begins[i]), float(ends[i]))
        for i in range(first, len(pieces))
        if not isinstance(pieces[i], Still) and pieces[i].duration_s > 2.0
    ]
