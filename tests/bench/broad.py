"""Trials of the BROAD benchmark, and what is made of them to try a bias tracker.

The true bias is the mean reading of the rests, trimmed by half a second, and linear between them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from tests.bench.trackers import Floats

FOLDER = Path(__file__).parents[2].parent / "shared" / "data" / "broad"
SCENARIOS = ("as recorded", "no rest before", "ramp 0.05 °/s/min", "bias of 3 °/s")
#: trials recorded with the same sensor
UNITS = (("04", "08"), ("10",), ("21", "28"), ("24",))

_TRIM_S, _LEAST_REST_S = 0.5, 2.0
_CUT_S = 1.0
#: so many samples before its own, optics saw what the gyro reads: there integrated rates agree best with it, in every fast trial
_OPTICS_AHEAD = 0.65
_RAMP_DPS_PER_MIN = np.array([0.05, -0.05, 0.05])
_LARGE_DPS = np.array([3.1065, -1.6171, 1.4467])


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """n samples: gyro rad/s, accel m/s², moving (n,), bias (n, 3) rad/s in truth, attitude (n, 4) wxyz, NaN where unseen."""

    name: str
    rate_hz: float
    gyro: Floats
    accel: Floats
    moving: NDArray[np.bool_]
    bias: Floats
    attitude: Floats

    @property
    def number(self) -> str:
        """BROAD's number of it."""
        return self.name[:2]

    def rmse_dps(self, bias: Floats) -> float:
        """Of an estimated bias (n, 3), while moving, per axis."""
        return float(np.degrees(np.sqrt(np.mean((bias - self.bias)[self.moving] ** 2))))

    def turned(self, matrix: Floats) -> "Trial":
        """The trial as read through a matrix (3, 3)."""
        return replace(self, gyro=self.gyro @ matrix.T, bias=self.bias @ matrix.T)


def trials(folder: Path = FOLDER) -> list[Trial]:
    """All that are there, as recorded."""
    return [load(path) for path in sorted(folder.glob("*.npz"))]


def load(path: Path) -> Trial:
    """One, as recorded."""
    with np.load(path) as file:
        columns = ("gyro_rad_s", "accel_m_s2", "truth_quat_wxyz")
        gyro, accel, attitude = (np.ascontiguousarray(file[name], np.float64) for name in columns)
        moving, rate_hz = file["moving"], float(file["rate_hz"])
    return Trial(path.stem, rate_hz, gyro, accel, moving, rest_bias(gyro, moving, rate_hz), _earlier(attitude))


def _earlier(attitude: Floats) -> Floats:
    """Attitudes (n, 4) wxyz as they were _OPTICS_AHEAD samples before; NaN where they were not seen just then."""
    seen = np.flatnonzero(~np.isnan(attitude[:, 0]))
    at = np.arange(len(attitude)) - _OPTICS_AHEAD
    known = np.zeros(len(attitude), bool)
    known[1:] = ~np.isnan(attitude[1:, 0] + attitude[:-1, 0])
    found = np.full_like(attitude, np.nan)
    between = Slerp(seen, Rotation.from_quat(np.roll(attitude[seen], -1, axis=1)))
    found[known] = np.roll(between(at[known]).as_quat(), 1, axis=1)
    return found


def rests(moving: NDArray[np.bool_], rate_hz: float) -> list[slice]:
    """Where it lies still for two seconds and more, trimmed at both ends."""
    edges = np.diff(np.concatenate([[0], ~moving, [0]]).astype(int))
    trim = int(_TRIM_S * rate_hz)
    return [
        slice(int(begin) + trim, int(end) - trim)
        for begin, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
        if end - begin >= _LEAST_REST_S * rate_hz
    ]


def rest_bias(gyro: Floats, moving: NDArray[np.bool_], rate_hz: float) -> Floats:
    """(n, 3) means over the rests, linear between them."""
    found = rests(moving, rate_hz)
    edges = np.array([[rest.start, rest.stop] for rest in found]).ravel()
    means = np.repeat([gyro[rest].mean(axis=0) for rest in found], 2, axis=0)
    return np.column_stack([np.interp(np.arange(len(gyro)), edges, mean) for mean in means.T])


def walk(everything: list[Trial]) -> float:
    """Rate random walk, rad/s per root second, that the first and last rests of all trials show."""
    square, seconds = 0.0, 0.0
    for trial in everything:
        first, *_, last = rests(trial.moving, trial.rate_hz)
        square += float(np.mean((trial.gyro[last].mean(axis=0) - trial.gyro[first].mean(axis=0)) ** 2))
        seconds += (last.start + last.stop - first.start - first.stop) / 2 / trial.rate_hz
    return float(np.sqrt(square / seconds))


def truth_std_dps(trial: Trial) -> float:
    """Standard deviation of the mean of a rest, °/s per axis, by the difference of its two halves."""
    halves = [np.array_split(trial.gyro[rest], 2) for rest in rests(trial.moving, trial.rate_hz)]
    apart = [one.mean(axis=0) - other.mean(axis=0) for one, other in halves]
    return float(np.degrees(np.sqrt(np.mean(np.square(apart)))) / 2)


def scenario(name: str, trial: Trial) -> Trial:
    """The trial as one of SCENARIOS has it."""
    began = int(np.argmax(trial.moving))
    if name == "no rest before":
        cut = began + int(_CUT_S * trial.rate_hz)
        return replace(
            trial,
            gyro=trial.gyro[cut:],
            accel=trial.accel[cut:],
            moving=trial.moving[cut:],
            bias=trial.bias[cut:],
            attitude=trial.attitude[cut:],
        )
    added = np.zeros((1, 3))
    if name.startswith("ramp"):
        minutes = np.maximum(0, np.arange(len(trial.gyro)) - began) / trial.rate_hz / 60
        added = np.radians(minutes[:, None] * _RAMP_DPS_PER_MIN)
    elif name.startswith("bias of"):
        added = np.radians(_LARGE_DPS[None])
    return replace(trial, gyro=trial.gyro + added, bias=trial.bias + added)


def siblings(trial: Trial, everything: list[Trial]) -> list[Trial]:
    """The other trials of its sensor."""
    unit = next((unit for unit in UNITS if trial.number in unit), ())
    return [other for other in everything if other.number in unit and other.number != trial.number]
