"""Checks whether the values of a recording can be in rad/s, m/s² and s.

A wrong unit is no small error: each is a factor of 57, of 9.8, or of a thousand, and would be corrected without a word.
"""

import logging
from math import degrees, radians
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.recording.error import RecordingError

_log = logging.getLogger(__name__)
Floats = NDArray[np.float64]
#: rad/s that no wearable turns at, and few gyros can read
ABSURD = 70.0
_ABSURD_S = 0.25
SLOWEST_HZ, FASTEST_HZ = 1.0, 20_000.0
#: how far a rate may be from what times say: devices are sold as of 100 Hz that have 104
_RATE_OFF = 0.2
#: no gap is as long as a quarter of a second where a device rests
_LEAST_HZ = 4.0
#: rad/s; twice the step of one that reads to 4000 °/s in 16 bits. So many samples tell of it; more are passed over
_COARSEST, _ENOUGH, _LOOKED_AT = radians(0.25), 100, 20_000
#: steps that are looked at together, and what they last at the most for any of them, over the usual one: longer is a gap
_TOGETHER, _GAP = 64, 2.5
#: the share of them that may be shorter than the shortest is taken to be; how much longer others may be, in steps
_SHORTEST, _EVEN = 0.02, 1.01
#: what the median length of the acceleration is near, in units that it is often given in, when it should be 9.8
_GRAVITIES = {"g": 1.0, "milli-g": 1000.0}
_NEAR = 0.25


def check_time(path: Path, time_s: Floats) -> None:
    """Refuse times (n,) whose median step is no IMU's."""
    step = float(np.median(np.diff(time_s)))
    if 1 / FASTEST_HZ <= step < 1 / SLOWEST_HZ:
        return
    unit = "milliseconds" if step < 1000 / SLOWEST_HZ else "microseconds"
    asked = f"is the time in {unit}? It must be in seconds" if step >= 1 / SLOWEST_HZ else "is it in its column's unit?"
    raise RecordingError(
        f"{path}: the time steps by {step:g} s, a rate of {1 / step:g} Hz; "
        f"{SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz is taken: {asked}"
    )


def rate_of(time_s: Floats) -> float:
    """Samples a second where none is missing, from their rising times (n,): by the median step, unless they are coarsely rounded.

    At 416 Hz, in milliseconds, steps are 2 and 3 ms, and the median says 500 Hz. Then many steps together never last only so
    many times the median, and always last nearly the same; where samples are lost here and there, one of both is not so.
    """
    steps = np.diff(time_s)
    step = float(np.median(steps))
    runs = steps[: len(steps) // _TOGETHER * _TOGETHER].reshape(-1, _TOGETHER)
    lasted = runs.sum(axis=1)[runs.max(axis=1) < _GAP * step]
    if len(lasted) < 2:
        return 1 / step
    shortest, middle = np.quantile(lasted, [_SHORTEST, 0.5])
    if abs(shortest / step - _TOGETHER) <= 0.5 or middle - shortest > _EVEN * step:
        return 1 / step
    return float(_TOGETHER / lasted[lasted <= shortest + _EVEN * step].mean())


def check_rate(path: Path, time_s: Floats, rate_hz: float) -> None:
    """Refuse a rate beside times (n,) that step at another, in the median (past gaps) and in the mean (of bunches)."""
    steps = np.diff(time_s)
    step = float(np.median(steps))
    if min(abs(step * rate_hz - 1), abs(float(steps.mean()) * rate_hz - 1)) > _RATE_OFF:
        raise RecordingError(
            f"{path}: its times step by {step:g} s, {1 / step:.4g} Hz, but its rate is said to be {rate_hz:g} Hz; "
            "leave the rate out, or mend the one that is wrong"
        )


def check_gyro(path: Path, gyro: Floats, rate_hz: float) -> None:
    """Refuse rates (n, 3), rad/s, that stay beyond any gyro's range; single spikes are mended later."""
    beyond = np.abs(gyro).max(axis=1) > ABSURD
    stays = beyond[:-2] & beyond[1:-1] & beyond[2:]
    if np.count_nonzero(stays) > _ABSURD_S * rate_hz:
        most = float(np.abs(gyro[1:-1][stays]).max())
        raise RecordingError(
            f"{path}: readings of {most:.0f} rad/s are probably degrees per second, given as rad/s; "
            "multiply them by π/180, or name a CSV's columns gx_dps, gy_dps, gz_dps"
        )


def warn_of_gyro(path: Path, gyro: Floats, rate_hz: float) -> None:
    """Warn of readings (n, 3), rad/s, too rare for rests to be seen, or rounded more than those of any gyro."""
    if rate_hz <= _LEAST_HZ:
        _log.warning(
            "%s: at %.3g Hz no rest can be seen, and so nothing learnt of bias or scale: more than %g Hz is needed",
            *(path, rate_hz, _LEAST_HZ),
        )
    some = gyro[:: len(gyro) // _LOOKED_AT + 1]
    apart = np.diff(np.sort(some, axis=0), axis=0)
    step = float(apart[apart > 1e-6].min(initial=np.inf))
    if len(some) >= _ENOUGH and _COARSEST < step < np.inf and np.allclose(some / step, np.rint(some / step), atol=0.01):
        _log.warning(
            "%s: its readings are rounded to %.2g °/s, as no gyro's are: export them with more digits; "
            "what is said of them is too sure, and a rest may not be seen",
            *(path, degrees(step)),
        )


def believed_accel(path: Path, accel: Floats | None) -> Floats | None:
    """The acceleration (n, 3), m/s²; None, with a warning, where it is in another unit."""
    if accel is None:
        return None
    length = float(np.median(np.linalg.norm(accel, axis=1)))
    for unit, gravity in _GRAVITIES.items():
        if abs(length / gravity - 1) < _NEAR:
            _log.warning(
                "%s: the accelerometer's median is %.4g, where gravity is 9.8: is it in %s? m/s² are expected; it is not used",
                path,
                length,
                unit,
            )
            return None
    return accel
