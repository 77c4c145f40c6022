"""Plausibility checks of a recording: whether its values can be in rad/s, m/s² and s.

A wrong unit is an error by a factor of 57, of 9.8 or of 1000, which correction would not detect.
"""

from math import degrees, radians
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.recording.error import RecordingError
from bridge.text.units import STANDARD_GRAVITY

Floats = NDArray[np.float64]
#: rad/s; no wearable turns this fast, and few gyros can read it
ABSURD = 70.0
_ABSURD_S = 0.25
SLOWEST_HZ, FASTEST_HZ = 1.0, 20_000.0
#: largest relative difference between a stated rate and the times' rate: devices sold as 100 Hz may have 104 Hz
_RATE_OFF = 0.2
#: below this rate a rest cannot be recognised, Hz: steps would count as gaps, which last a quarter of a second
_LEAST_HZ = 4.0
#: coarsest step, rad/s: twice that of 4000 °/s in 16 bits; fewest samples to judge by; most samples examined
_COARSEST, _ENOUGH, _LOOKED_AT = radians(0.25), 100, 20_000
#: steps per block when measuring the rate; a block with a step longer than _GAP usual steps has a gap
_TOGETHER, _GAP = 64, 2.5
#: share of blocks that may be shorter than the one taken as the shortest; spread of even blocks, in steps
_SHORTEST, _EVEN = 0.02, 1.01
#: plausible median length of an acceleration, in g; relative tolerance for gravity in another unit
_LEAST_G, _MOST_G, _NEAR = 0.6, 1.7, 0.25
#: °/s/√Hz at rest: half of the best MEMS gyro's (Epson M-G370: 0.0017), four times the worst's
_QUIETEST, _LOUDEST = 0.001, 0.2
#: share of readings that are zero on all axes, and run length, from which a device is taken to zero itself at rest
_ZEROED, _ZEROED_RUN = 0.05, 10
_FEW_VALUES, _WHITE, _WINDOWS = 6, 0.7, 1000


def check_time(path: Path, time_s: Floats) -> None:
    """Check that sample times (n,), s, give a plausible sampling rate: the inverse of their median step.

    path: the file's name in the error. Raises RecordingError if the rate is not from SLOWEST_HZ to FASTEST_HZ.
    """
    step = float(np.median(np.diff(time_s)))
    if 1 / FASTEST_HZ <= step < 1 / SLOWEST_HZ:
        return
    raise RecordingError(
        f"{path}: consecutive times differ by {step:g} s, a rate of {1 / step:g} Hz; "
        f"{SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz is possible. Give the right --time-unit (ms, us, ns), or --rate-hz"
    )


def rate_of(time_s: Floats) -> float:
    """Return the sampling rate, Hz, from rising times (n,), s; gaps are excluded.

    Method: the inverse of the median step. If the times are coarsely rounded, the mean duration of blocks of 64 steps
    is used instead.

    Example: at 416 Hz, times in whole milliseconds step by 2 and 3 ms, and the median step gives 500 Hz.
    Rounded times are recognised by two properties of the blocks. All blocks last nearly the same, and no block lasts
    64 median steps. If single samples are lost, at least one property does not hold.
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
    """Check that the steps of sample times (n,), s, agree with a stated rate within 20 %.

    Either the median step or the mean step must agree: the median is not affected by gaps, the mean not by bursts.
    path: the file's name in the error. rate_hz: the stated rate, Hz. Raises RecordingError if neither agrees.
    """
    steps = np.diff(time_s)
    step = float(np.median(steps))
    if min(abs(step * rate_hz - 1), abs(float(steps.mean()) * rate_hz - 1)) > _RATE_OFF:
        raise RecordingError(
            f"{path}: the times step by {step:g} s ({1 / step:.4g} Hz), but the file states {rate_hz:g} Hz; "
            "give the right rate with --rate-hz, which replaces the times"
        )


def check_gyro(path: Path, gyro: Floats, rate_hz: float) -> None:
    """Check that readings (n, 3), rad/s, stay within ±70 rad/s, the range of gyros; single spikes are allowed.

    path: the file's name in the error. rate_hz: sampling rate. Raises RecordingError if readings exceed the range for
    longer than 0.25 s in total.
    """
    if max(gyro.max(), -gyro.min()) <= ABSURD:
        return
    beyond = np.abs(gyro).max(axis=1) > ABSURD
    stays = beyond[:-2] & beyond[1:-1] & beyond[2:]
    if np.count_nonzero(stays) > _ABSURD_S * rate_hz:
        most = float(np.abs(gyro[1:-1][stays]).max())
        raise RecordingError(
            f"{path}: readings of {most:.0f} rad/s are probably degrees per second, given as rad/s; "
            "give --gyro-unit deg/s, or multiply the array by π/180"
        )


def doubts_of_gyro(gyro: Floats, rate_hz: float) -> list[str]:
    """Return sentences on implausible properties of readings (n, 3), rad/s; empty if there are none.

    Checked: sampling rate too low, resolution too coarse, noise too small or too large, an axis constant, readings
    set to zero at rest.
    rate_hz: sampling rate.
    """
    doubts = []
    if rate_hz <= _LEAST_HZ:
        doubts.append(
            f"at {rate_hz:.3g} Hz rests cannot be detected, so nothing can be calibrated: record at more than {_LEAST_HZ:g} Hz"
        )
    some = gyro[:: len(gyro) // _LOOKED_AT + 1]
    apart = np.diff(np.sort(some, axis=0), axis=0)
    step = float(apart[apart > 1e-6].min(initial=np.inf))
    coarse = (
        len(some) >= _ENOUGH and _COARSEST < step < np.inf and np.allclose(some / step, np.rint(some / step), atol=0.01)
    )
    if coarse:
        doubts.append(
            f"the readings are rounded to {degrees(step):.2g} °/s, coarser than any gyro: export them with more digits, "
            "otherwise the stated uncertainty is too small and rests may be missed"
        )
    if len(gyro) < _ENOUGH:
        return doubts
    dead = [axis for axis, still in zip("xyz", np.ptp(gyro, axis=0) == 0, strict=True) if still]
    if dead and len(dead) < 3:
        doubts.append(
            f"{' and '.join(dead)} of the gyro never changes: that axis is dead or stuck, and cannot be calibrated"
        )
    zero = (gyro[:, 0] == 0) & (gyro[:, 1] == 0) & (gyro[:, 2] == 0)
    if not zero.all() and float(zero.mean()) > _ZEROED and _longest(zero) >= _ZEROED_RUN:
        doubts.append(
            f"{zero.mean():.0%} of the readings are exactly zero on all axes: the device corrects itself at rest and hides its "
            "bias; switch this off in the device's settings"
        )
    elif not dead and not coarse:
        doubts += _doubts_of_noise(gyro, rate_hz)
    return doubts


def _doubts_of_noise(gyro: Floats, rate_hz: float) -> list[str]:
    """Return a doubt if the quietest second is quieter or louder than any MEMS gyro's: its unit may be wrong."""
    size = max(16, round(rate_hz))
    n = len(gyro) // size
    if n < 3:
        return []
    windows = gyro[: n * size].reshape(n, size, 3)[:: n // _WINDOWS + 1]
    spread = windows.std(axis=1)
    std = np.sort(np.median(spread, axis=1))
    distinct = np.median([len(np.unique(window[:, axis])) for window in windows[:20] for axis in range(3)])
    density = degrees(float(np.quantile(std, 0.2))) / np.sqrt(rate_hz)
    if density < _QUIETEST and distinct > _FEW_VALUES:
        return [
            (
                f"the noise at rest is {density:.2g} °/s/√Hz, less than any MEMS gyro's: the unit is probably rad/s, not °/s; "
                "then give --gyro-unit rad/s"
            )
        ]
    rest = windows[int(np.argmin(spread.max(axis=1)))]
    # A movement is smooth, so the steps between its readings show the noise.
    by_steps = np.diff(rest, axis=0).std(axis=0) / np.sqrt(2)
    loudest = degrees(float(np.median(by_steps))) / np.sqrt(rate_hz)
    if loudest > _LOUDEST and (by_steps > _WHITE * rest.std(axis=0)).all():
        return [
            (
                f"the noise in the quietest second is {loudest:.2g} °/s/√Hz, more than any gyro's: the device never rested, or "
                "the unit is °/s, not rad/s; then give --gyro-unit deg/s"
            )
        ]
    return []


def quietest(gyro: Floats, rate_hz: float) -> slice:
    """Return the rows of the quietest window of 1 s in readings (n, 3), rad/s.

    Method: of consecutive windows of 1 s, the one whose largest standard deviation over the three axes is smallest. A
    window has at least 16 rows. A recording shorter than two windows is returned whole. rate_hz: sampling rate.
    """
    size = max(16, round(rate_hz))
    n = len(gyro) // size
    if n < 2:
        return slice(0, len(gyro))
    std = gyro[: n * size].reshape(n, size, 3).std(axis=1).max(axis=1)
    at = int(np.argmin(std)) * size
    return slice(at, at + size)


def _longest(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def believed_accel(accel: Floats | None) -> tuple[Floats | None, str]:
    """Check that the median magnitude of the acceleration (n, 3), m/s², is 0.6 to 1.7 times gravity, 9.8 m/s².

    If so, returns the acceleration and an empty text. If not, returns None and the reason, a sentence for the user.
    Without an acceleration, returns None and an empty text.
    """
    if accel is None or not len(accel):
        return None, ""
    length = float(np.median(np.linalg.norm(accel, axis=1)))
    if _LEAST_G < length / STANDARD_GRAVITY < _MOST_G:
        return accel, ""
    said = f"the accelerometer's median length is {length:.4g} m/s², but gravity is 9.8"
    for asked, factor in (("g", 1 / STANDARD_GRAVITY), ("mg", 1e3 / STANDARD_GRAVITY), ("m/s2", 1.0)):
        for claimed, made in (("m/s²", 1.0), ("g", STANDARD_GRAVITY), ("mg", STANDARD_GRAVITY * 1e-3)):
            if factor * made != 1 and abs(length / (STANDARD_GRAVITY * factor * made) - 1) < _NEAR:
                return (
                    None,
                    f"{said}: not used. The unit is probably {asked}, not {claimed}; then give --accel-unit {asked}",
                )
    if length < _LEAST_G * STANDARD_GRAVITY:
        return None, f"{said}: not used. Gravity was probably removed; record with gravity"
    return None, f"{said}: not used. The values may be counts; then give the counts per g with --accel-sensitivity"
