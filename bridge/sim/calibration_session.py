"""Simulates a whole calibration session as arrays, for studies that need many sessions fast."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, Truth
from bridge.sim.motion import Motion, TrueMotion
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, flat, session
from bridge.sim.quaternion import Array

TICK_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Simulated calibration session: n samples of readings, and the true values behind them.

    rate_hz: output data rate. ticks (n,): sample times in units of TICK_S, not wrapped. time_s (n,): the same in s.
    Sample i covers (time_s[i-1], time_s[i]]; the first sample begins at 0.
    gyro (n, 3): rad/s. accel (n, 3): m/s². temperature_c (n,). All vectors are in sensor axes.
    truth: true parameters of the sensor. bias (n, 3): true bias at each sample, rad/s. motion: true motion.
    stages (m, 2): rows of rest, turn, rest …, with rests at even rows. Columns are the first sample, and the sample
    after the last. A sample whose interval overlaps a turn belongs to the turn.
    """

    rate_hz: float
    ticks: NDArray[np.int64]
    time_s: Array
    gyro: Array
    accel: Array
    temperature_c: Array
    truth: Truth
    bias: Array
    motion: TrueMotion
    stages: NDArray[np.int64]


def simulate_session(
    seed: int,
    *,
    noise_dps: float = 0.03,
    wobble_deg: float = 0.0,
    tilt_deg: float = 0.0,
    replacement_deg: float = 0.0,
    rate_hz: float = 104.0,
    rests_s: float | tuple[float, ...] = 3.2,
    turns: tuple[TurnPlan, ...] | None = None,
    turn_s: tuple[float, float] = (3.5, 6.0),
    spec: ImuSpec | None = None,
) -> Session:
    """Simulate a calibration session, from motion to readings; the same arguments always give the same session.

    seed: seed of all random values. rate_hz: output data rate. spec: error limits of the sensor; None for ImuSpec().
    noise_dps: white noise, standard deviation per sample, °/s; it replaces that of `spec`.
    rests_s: duration of every rest, or one duration for each. turns: plans of the turns; None draws one turn of 360°
    about each axis. turn_s: shortest and longest duration of a turn, s.
    wobble_deg: largest tilt of a turn's axis during the turn. tilt_deg: largest angle between a turn's axis and the
    sensor axis.
    replacement_deg: closure error of a turn (end attitude against start attitude), standard deviation per axis.
    Raises ValueError if the number of rests does not fit the number of turns.
    The random draws of scale, bias and noise depend on the seed alone. Sessions with other motion or noise level
    therefore have the same simulated device.
    """
    script_rng, device_rng = np.random.default_rng(seed).spawn(2)
    plan = SessionPlan(rests_s, turns, turn_s, wobble_deg, tilt_deg, replacement_deg)
    pieces = session(script_rng, plan)
    ends_s = np.cumsum([piece.duration_s for piece in pieces])
    ticks = np.round(np.arange(1, int(ends_s[-1] * rate_hz) + 1) / (rate_hz * TICK_S)).astype(np.int64)
    time_s: Array = np.asarray(ticks * TICK_S, dtype=np.float64)
    motion = Motion(pieces, flat(script_rng)).advance(time_s)
    imperfection = ImuErrorModel(replace(spec or ImuSpec(), noise_dps=noise_dps), device_rng)
    readings = imperfection.read(motion)
    return Session(
        rate_hz=rate_hz,
        ticks=ticks,
        time_s=time_s,
        gyro=readings.gyro,
        accel=readings.accel,
        temperature_c=readings.temperature_c,
        truth=imperfection.truth,
        bias=readings.bias,
        motion=motion,
        stages=_stages(time_s, ends_s),
    )


def _stages(time_s: Array, ends_s: Array) -> NDArray[np.int64]:
    edges = np.searchsorted(time_s, ends_s, side="right")
    edges[1::2] = np.searchsorted(time_s, ends_s[1::2], side="left") + 1
    edges[-1] = len(time_s)
    return np.column_stack([np.concatenate([[0], edges[:-1]]), edges]).astype(np.int64)
