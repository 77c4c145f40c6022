"""Noise identification: estimates a device's gyro noise per axis from the longest rest in a recording.

The rest is recognised from the samples alone.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.recording import Recording, RecordingError
from bridge.recording.plausibility import rate_of
from estimator.geometry.gyro_model import AXES, least_step
from estimator.noise.allan_fit import Coefficient, Noise, identify
from estimator.noise.device_model import NoiseModel
from estimator.stillness.detector import Stillness

Floats = NDArray[np.float64]
#: shortest rest that says anything about angle random walk, s: a minute, less the windows dropped at its ends
LEAST_REST_S = 55.0
#: stillness windows dropped at both ends of a rest, where a hand still touched the device
_EDGE = 4
#: largest share of a rest that may be missing or bunched before its samples count as unevenly spaced
_UNEVEN = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class AtRest:
    """Noise of the gyro axes x, y and z in one rest of a recording.

    axes: for x, y and z: angle random walk (rad/s/√Hz), bias instability (rad/s), rate random walk (rad/s/√s), and the
    Allan deviation (rad/s) from which they follow.
    start_s, end_s: start and end of the rest, s since the first sample. total_s: length of the recording, s. rate_hz:
    measured samples per second in the rest.
    mean, std (3,): mean and standard deviation of the readings, rad/s. step (3,): rounding step of the readings, which
    is the smallest difference between unequal ones, rad/s.
    temperature_c: lowest and highest temperature, °C; None if not recorded.
    """

    axes: tuple[Noise, Noise, Noise]
    start_s: float
    end_s: float
    total_s: float
    rate_hz: float
    mean: Floats
    std: Floats
    step: Floats
    temperature_c: tuple[float, float] | None

    @property
    def duration_s(self) -> float:
        """Length of the rest, s."""
        return self.end_s - self.start_s


def identify_noise(recording: Recording) -> AtRest:
    """Identify noise coefficients of each gyro axis in the longest rest of a recording, from its Allan deviation.

    Raises RecordingError if the rest is too short, its samples are unevenly spaced, or an axis reads the same
    throughout.
    """
    rest = _longest_rest(recording)
    time, gyro = recording.time_s[rest], recording.gyro[rest]
    duration = float(time[-1] - time[0]) if len(time) else 0.0
    if duration < LEAST_REST_S:
        raise RecordingError(
            f"{recording.name}: its longest rest lasts {duration:.0f} s of {recording.time_s[-1]:.0f} s; at least "
            f"{LEAST_REST_S:.0f} s are needed. Lay the device down where nobody walks, and record an hour to see its bias wander"
        )
    rate_hz = (len(time) - 1) / duration
    if (missing := 1 - rate_hz / rate_of(time)) > _UNEVEN:
        raise RecordingError(
            f"{recording.name}: the samples are not evenly spaced: {missing:.0%} of the longest rest is missing. If the times are"
            " times of arrival, remove them from the file and give the device's rate with --rate-hz"
        )
    for axis, name in enumerate(AXES):
        if np.ptp(gyro[:, axis]) == 0:
            raise RecordingError(
                f"{recording.name}: {name} reads the same throughout the rest. The axis is stuck, or its "
                "rounding step exceeds its noise. Choose the smallest full-scale range"
            )
    x, y, z = (identify(gyro[:, axis], rate_hz) for axis in range(3))
    celsius = None if recording.temperature_c is None else recording.temperature_c[rest]
    return AtRest(
        axes=(x, y, z),
        start_s=float(time[0]),
        end_s=float(time[-1]),
        total_s=float(recording.time_s[-1]),
        rate_hz=rate_hz,
        mean=gyro.mean(axis=0),
        std=gyro.std(axis=0, ddof=1),
        step=least_step(gyro),
        temperature_c=None if celsius is None else (float(celsius.min()), float(celsius.max())),
    )


def measured(rest: AtRest, like: NoiseModel) -> tuple[NoiseModel, dict[str, str]]:
    """Return a noise model of the measured device, and the origin of each of its fields as text, by field name.

    like: noise model of the device's kind. A noise coefficient that the rest does not determine is taken from `like`,
    or is the measured upper limit if that is less.
    """
    origin = {"step": "measured"}

    def best(name: str) -> Floats:
        found: list[Coefficient] = [getattr(axis, name) for axis in rest.axes]
        seen = "".join(axis for axis, c in zip(AXES, found, strict=True) if c.seen)
        also = f"; {', '.join(seen)} measured" if seen else ""
        origin[name] = "measured" if len(seen) == len(AXES) else f"{like.model}'s, or the upper limit if less{also}"
        kind = getattr(like, name)
        return np.array([c.value if c.seen else min(c.high, kind[i]) for i, c in enumerate(found)])

    noise = replace(like, arw=best("arw"), bias_instability=best("bias_instability"), rrw=best("rrw"), step=rest.step)
    return noise, origin


def _longest_rest(recording: Recording) -> slice:
    runs: list[list[int]] = [[]]
    for window in Stillness().feed(recording.time_s, recording.gyro, recording.accel):
        if not window.still or window.spikes:
            runs.append([])
            continue
        runs[-1].append(window.start)
    run = max(runs, key=len)[_EDGE:-_EDGE]
    return slice(run[0], run[-1]) if run else slice(0, 0)
