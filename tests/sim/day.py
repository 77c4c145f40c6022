"""Hours on a wearer as arrays, with all that is true of them.

A device's character (scale, misalignment, temperature law) is its seed's; each of its boots has a turn-on bias of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.sim.body import Activity, Body
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, Truth, draw
from bridge.sim.quaternion import Array
from bridge.sim.wearer import Wearer
from tests.sim.warmth import ROOM_C, SKIN_C, Temperature, Warmth

Float32s = NDArray[np.float32]

_BLOCK = 16_384
#: from one power-up to the next, standard deviation per axis
_TURN_ON_DPS = 0.15
#: per root hertz: °/s and m/s²
_GYRO_DENSITY_DPS, _ACCEL_DENSITY = 0.015, 0.0023
_ICM20948 = ImuSpec(
    scale=(0.97, 1.03),
    misalignment_deg=1.0,
    rrw_dps_per_sqrt_s=7e-4,
    bias_dps_per_kelvin=0.03,
    bias_dps_per_kelvin2=5e-4,
    temperature_c=(ROOM_C, SKIN_C),
    range_dps=500.0,
    step_dps=1 / 65.5,
    accel_bias=0.05,
    accel_scale=0.005,
)


def worn_spec(rate_hz: float, *, calibrated: bool = True) -> ImuSpec:
    """An ICM-20948 at ± 500 °/s, its white noise up to half the sample rate.

    As bought (± 5 °/s, ± 3 %, ± 1°), or read through a calibration by hand (± 0.5 °/s, ± 0.2 %, ± 0.1° are left).
    """
    white = float(np.sqrt(rate_hz / 2))
    spec = replace(_ICM20948, noise_dps=_GYRO_DENSITY_DPS * white, accel_noise=_ACCEL_DENSITY * white)
    return replace(spec, scale=(0.998, 1.002), misalignment_deg=0.1, bias_limit_dps=0.5) if calibrated else spec


@dataclass(frozen=True, slots=True, eq=False)
class Day:
    """n samples and the truth of them, in float32 but for time. Sample i holds over (time_s[i-1], time_s[i]], from 0.

    gyro (n, 3) rad/s, accel (n, 3) m/s², temperature_c (n,): what is read. bias (n, 3) rad/s: the reading at zero rate.
    rate (n, 3) rad/s, attitude (n, 4) wxyz sensor -> earth: what is true. activity (n,): Activity at the end of each sample.
    """

    rate_hz: float
    time_s: Array
    gyro: Float32s
    accel: Float32s
    temperature_c: Float32s
    bias: Float32s
    rate: Float32s
    attitude: Float32s
    activity: NDArray[np.int8]
    truth: Truth


def simulate_day(
    seed: int,
    hours: float = 8.0,
    rate_hz: float = 104.0,
    spec: ImuSpec | None = None,
    *,
    calibrated: bool = True,
    boot: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> Day:
    """The day of this seed's device and wearer, from power-up on; another boot is another day of the same device.

    spec: in place of worn_spec(rate_hz, calibrated). progress is told the share that is done.
    """
    spec = spec or worn_spec(rate_hz, calibrated=calibrated)
    truth = draw(spec, np.random.default_rng([seed, 0]))
    life_rng, sensor_rng, warmth_rng = np.random.default_rng([seed, 1 + boot]).spawn(3)
    changed = np.radians(_TURN_ON_DPS) * sensor_rng.normal(size=3)
    sensor = ImuErrorModel(spec, sensor_rng, replace(truth, turn_on_bias=truth.turn_on_bias + changed))
    body = Body(Wearer(life_rng).life(), life_rng.uniform(-0.2, 0.2, 3), anyhow(life_rng))
    return recorded(body, sensor, Warmth(warmth_rng), hours * 3600, rate_hz, progress)


def recorded(
    body: Body,
    sensor: ImuErrorModel,
    warmth: Temperature,
    duration_s: float,
    rate_hz: float,
    progress: Callable[[float], None] = lambda _: None,
) -> Day:
    """What the sensor makes of that much of a life."""
    n = int(duration_s * rate_hz)
    shapes = {"gyro": 3, "accel": 3, "bias": 3, "rate": 3, "attitude": 4}
    kept = {name: np.empty((n, width), np.float32) for name, width in shapes.items()}
    temperature_c, activity = np.empty(n, np.float32), np.empty(n, np.int8)
    time_s: Array = np.arange(1, n + 1) / rate_hz
    for begin in range(0, n, _BLOCK):
        here = slice(begin, begin + _BLOCK)
        true = body.advance(time_s[here])
        worn = np.isin(true.activity, [one for one in Activity if one.worn])
        read = sensor.read(true, warmth.at(true.time_s, worn))
        for name in ("gyro", "accel", "bias"):
            kept[name][here] = getattr(read, name)
        kept["rate"][here], kept["attitude"][here] = true.rate, true.attitude
        temperature_c[here], activity[here] = read.temperature_c, true.activity
        progress(min(1.0, (begin + _BLOCK) / n))
    return Day(rate_hz, time_s, temperature_c=temperature_c, activity=activity, truth=sensor.truth, **kept)


def anyhow(rng: np.random.Generator) -> Array:
    """Any attitude (4,) wxyz, all alike."""
    q = rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))
