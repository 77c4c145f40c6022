"""Simulated recordings of a device on a turntable or a servo."""

import numpy as np

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import machine
from estimator.calibration.capture import Samples
from tests.estimator.stream import Stream, stream

TABLE_DPS = (30.0, 60.0, 90.0)
SERVO_DPS = (25.0,)


def turned(
    mounts: np.ndarray, rates_dps: tuple[float, ...], seed: int, spec: ImuSpec, *, rest_s: float = 2.5
) -> Stream:
    """Both ways at each rate in each mounting."""
    both = tuple(sign * rate for rate in rates_dps for sign in (1.0, -1.0))
    pieces = machine(mounts, both, spin_s=4.5, rest_s=rest_s)
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=spec)


def on_a_turntable(seed: int, *, misalignment_deg: float = 0.5, noise_dps: float = 0.03) -> Stream:
    return turned(np.eye(3), TABLE_DPS, seed, ImuSpec(misalignment_deg=misalignment_deg, noise_dps=noise_dps))


def on_a_servo(seed: int, *, misalignment_deg: float = 0.0, noise_dps: float = 0.03) -> Stream:
    """Mounted askew, three times."""
    mounts = np.eye(3) + 0.2 * np.random.default_rng(seed).normal(size=(3, 3))
    mounts /= np.linalg.norm(mounts, axis=1)[:, None]
    return turned(
        mounts, SERVO_DPS, seed, ImuSpec(misalignment_deg=misalignment_deg, noise_dps=noise_dps, accel_bias=0.1)
    )


def samples(of: Stream) -> Samples:
    return Samples(of.time, of.gyro, of.accel, np.zeros(len(of), bool))
