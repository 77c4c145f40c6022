"""Small scenes for one question each: a slow turn between two rests, a walk, rests and motion as a bias filter models them."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from bridge.sim.body import Activity, Body, Stretch
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec
from bridge.sim.motion import Motion, Still
from bridge.sim.motion_scripts import SessionPlan, flat, session, worn
from bridge.sim.quaternion import Array
from bridge.sim.wearer import Wearer
from tests.sim.day import Day, anyhow, recorded, worn_spec
from tests.sim.warmth import Warmth

#: how seldom the temperature steps, s
_STEP_EVERY_S = 200.0


def slow_turn(
    rate_dps: float,
    seconds: float = 60.0,
    *,
    rest_s: float = 60.0,
    breath: float = 0.0,
    seed: int = 0,
    rate_hz: float = 104.0,
    spec: ImuSpec | None = None,
) -> Day:
    """Still on a ward, turned about the vertical at an even rate for so many seconds, and still again.

    breath: 0 for a device that lies, 1 for one on a wearer that breathes. Turned samples are of Activity.SLOW_TURN.
    """
    rng, sensor_rng = np.random.default_rng([seed, 2]).spawn(2)
    wearer = Wearer(rng)

    def rest() -> Stretch:
        return wearer.quiet(Activity.LYING, rest_s, breath=breath) if breath else wearer.table(rest_s)

    stretches = [rest(), wearer.turned(rate_dps, seconds, breath=breath), rest()]
    body = Body(iter(stretches), attitude=anyhow(rng))
    spec = spec or worn_spec(rate_hz)
    duration_s = sum(one.duration_s for one in stretches)
    steady = Steps(rng, 0.0, spec.temperature_c[0], duration_s)
    return recorded(body, ImuErrorModel(spec, sensor_rng), steady, duration_s, rate_hz)


def rests_and_motion(
    seed: int,
    seconds: float = 600.0,
    rate_hz: float = 50.0,
    *,
    rrw_dps_per_sqrt_s: float = 2e-3,
    noise_dps: float = 0.1,
    rest_s: tuple[float, float] = (3.0, 20.0),
    motion_s: tuple[float, float] = (5.0, 60.0),
    bias_dps_per_kelvin: float = 0.0,
    step_k: float = 0.0,
) -> Day:
    """True rests and free movement in turn; the bias a pure random walk, the gyro's noise white, all else perfect.

    step_k: standard deviation, K, of a step of temperature every few minutes; the bias follows at a fixed ± per kelvin.
    """
    rng, sensor_rng, warmth_rng = np.random.default_rng([seed, 3]).spawn(3)
    wearer = Wearer(rng)

    def life() -> Iterator[Stretch]:
        while True:
            yield Stretch(Activity.TABLE, rng.uniform(*rest_s))
            yield wearer.moved(rng.uniform(*motion_s), 90)

    spec = ImuSpec(
        scale=(1.0, 1.0),
        bias_limit_dps=1.0,
        noise_dps=noise_dps,
        rrw_dps_per_sqrt_s=rrw_dps_per_sqrt_s,
        bias_dps_per_kelvin=bias_dps_per_kelvin,
        range_dps=np.inf,
    )
    steps = Steps(warmth_rng, step_k, spec.temperature_c[0], seconds)
    body = Body(life(), attitude=anyhow(rng))
    return recorded(body, ImuErrorModel(spec, sensor_rng), steps, seconds, rate_hz)


def walk_with_pauses(
    seed: int, rate_hz: float = 50.0, *, rest_s: float = 120.0, walk_s: float = 900.0, spec: ImuSpec | None = None
) -> Day:
    """On a table, then put on and walked with; in no pause does anybody stand quite still, and the skin warms the device."""
    rng, sensor_rng, warmth_rng = np.random.default_rng([seed, 4]).spawn(3)
    wearer = Wearer(rng)

    def life() -> Iterator[Stretch]:
        yield wearer.table(rest_s)
        while True:
            yield from wearer.leg_and_pause()

    body = Body(life(), attitude=anyhow(rng))
    imperfect = ImuErrorModel(spec or worn_spec(rate_hz), sensor_rng)
    return recorded(body, imperfect, Warmth(warmth_rng), rest_s + walk_s, rate_hz)


def steady_walk(
    seed: int, rate_hz: float = 50.0, *, rest_s: float = 120.0, walk_s: float = 900.0, spec: ImuSpec | None = None
) -> Day:
    """On a table, then put on and walked with, round corners and without a pause; the skin warms the device."""
    rng, sensor_rng, warmth_rng = np.random.default_rng([seed, 5]).spawn(3)
    wearer = Wearer(rng)
    body = Body(iter([wearer.table(rest_s), wearer.leg(walk_s)]), attitude=anyhow(rng))
    imperfect = ImuErrorModel(spec or worn_spec(rate_hz), sensor_rng)
    return recorded(body, imperfect, Warmth(warmth_rng), rest_s + walk_s, rate_hz)


def turned_by_hand(seed: int, rate_hz: float = 50.0, *, spec: ImuSpec | None = None) -> Day:
    """Still, turned once about each axis on a table with rests between, then worn for half a minute, and put to rest."""
    rng, sensor_rng = np.random.default_rng([seed, 6]).spawn(2)
    pieces = session(rng, SessionPlan(wobble_deg=2.0, tilt_deg=3.0, replacement_deg=0.2))
    pieces += [*islice(worn(rng), 10), Still(3.0)]
    duration_s = sum(piece.duration_s for piece in pieces)
    motion = Motion(pieces, flat(rng))
    time_s = np.arange(1, int(duration_s * rate_hz) + 1) / rate_hz
    true, imperfect = motion.advance(time_s), ImuErrorModel(spec or worn_spec(rate_hz, calibrated=False), sensor_rng)
    read = imperfect.read(true)
    columns = (read.gyro, read.accel, read.temperature_c, read.bias, true.rate, true.attitude)
    gyro, accel, temperature_c, bias, rate, attitude = (np.asarray(column, np.float32) for column in columns)
    activity = np.full(len(time_s), Activity.MOVING, np.int8)
    return Day(rate_hz, time_s, gyro, accel, temperature_c, bias, rate, attitude, activity, imperfect.truth)


class Steps:
    """A temperature that jumps every few minutes by a normal step of that many K."""

    def __init__(self, rng: np.random.Generator, step_k: float, start_c: float, seconds: float) -> None:
        steps = step_k * rng.normal(size=int(seconds / _STEP_EVERY_S) + 1)
        self._temperature_c = start_c + np.cumsum(np.concatenate([[0.0], steps]))

    def at(self, time_s: Array, worn: NDArray[np.bool_]) -> Array:
        """See Temperature."""
        return np.asarray(self._temperature_c[(time_s / _STEP_EVERY_S).astype(int)])
