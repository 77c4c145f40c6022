"""truerate, VQF, and the limits of both: methods that find bias and orientation of a BROAD trial.

The limits are truerate told what it cannot know (that the device is warm, the walk of the bias as the rests of all trials show
it, the matrix that optics fits to the trial, an accelerometer that shows gravity alone); a filter that sees optical
orientation; the mean of the latest rest, of one who is told the rests; and orientation from the true bias.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import vqf

from bridge.recording import Recording
from bridge.wire.messages import Quality
from estimator.device.correction import Correction
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import GyroModel
from estimator.offline.recordings import correct
from estimator.orientation.attitude import Attitude
from estimator.orientation.smoothing import smooth
from tests.bench import broad
from tests.bench.optical import bias_by_optics, level_force, matrix_of
from tests.bench.trackers import Floats

#: how much faster a bias may walk than the model says
HURRY = 4.0
#: rad/s, what the filter that sees optics is told of the bias; relative, what truerate is told of the true matrix
_BIAS_STD, _MATRIX_STD = np.radians(0.5), 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a method makes of a recording: bias and its std (n, 3) rad/s, attitudes (n, 4); None where it gives none."""

    bias: Floats | None = None
    std: Floats | None = None
    quat_wxyz: Floats | None = None


Method = Callable[[broad.Trial], Found]


def methods(knobs: SessionKnobs, walk: float) -> dict[str, Method]:
    """All rows of the tables; walk, rad/s per root second: that of the true bias."""
    own = knobs.track.bias.rate_random_walk
    prior = replace(knobs.prior, scale_std=_MATRIX_STD, misalignment_std=_MATRIX_STD)
    exact = replace(knobs, prior=prior)
    return {
        "VQF": lambda trial: _vqf(trial, offline=False),
        "VQF offline": lambda trial: _vqf(trial, offline=True),
        "truerate": partial(ours, knobs=knobs),
        "truerate smoothed": partial(ours, knobs=knobs, smoothed=True),
        "told that it is warm": partial(ours, knobs=walking(knobs, own)),
        "told the walk": partial(ours, knobs=walking(knobs, walk)),
        "true matrix": partial(ours_through, knobs=exact),
        "true matrix, smoothed": partial(ours_through, knobs=exact, smoothed=True),
        "true matrix, gravity alone": partial(ours_through, knobs=exact, pushed=False),
        f"the same, walk ×{HURRY:g}": partial(ours_through, knobs=walking(exact, HURRY * own), pushed=False),
        "optics": partial(optics, walk=own),
        f"optics, walk ×{HURRY:g}": partial(optics, walk=HURRY * own),
        "rests told": rests_told,
        "true bias": partial(from_true_bias, through=False),
        "true bias and matrix": partial(from_true_bias, through=True),
        "true bias and matrix, smoothed": partial(from_true_bias, through=True, smoothed=True),
    }


def walking(knobs: SessionKnobs, walk: float) -> SessionKnobs:
    """The settings of a device that is warm, and whose bias walks like this: rad/s per root second."""
    bias = replace(knobs.track.bias, warm_up_walk=0.0, rate_random_walk=walk)
    return replace(knobs, track=replace(knobs.track, bias=bias))


def _vqf(trial: broad.Trial, *, offline: bool) -> Found:
    gyro, accel, step = trial.gyro, trial.accel, 1 / trial.rate_hz
    state = vqf.offlineVQF(gyro, accel, None, step) if offline else vqf.VQF(step).updateBatchFullState(gyro, accel)
    return Found(state["bias"], None, state["quat6D"])


def ours(trial: broad.Trial, knobs: SessionKnobs, *, smoothed: bool = False) -> Found:
    """As `truerate correct` gives it."""
    c = correct(Recording.from_arrays(trial.gyro, trial.accel, rate_hz=trial.rate_hz), knobs=knobs, smooth=smoothed)
    return Found(c.bias.astype(float), c.bias_std.astype(float), c.quat_wxyz.astype(float))


def ours_through(trial: broad.Trial, knobs: SessionKnobs, *, smoothed: bool = False, pushed: bool = True) -> Found:
    """The same from rates through the matrix that optics fits to this trial; the bias is that of the reading as it was.

    pushed: whether the accelerometer shows more than gravity, as it does.
    """
    matrix, accel = matrix_of([trial]), trial.accel if pushed else level_force(trial)
    found = ours(replace(trial.turned(matrix), accel=accel), knobs, smoothed=smoothed)
    assert found.bias is not None
    return replace(found, bias=found.bias @ np.linalg.inv(matrix).T)


def optics(trial: broad.Trial, walk: float) -> Found:
    """In real time, by a filter that sees the optical orientation; walk: rad/s per root second."""
    return Found(bias_by_optics(trial, matrix_of([trial]), walk, _BIAS_STD))


def rests_told(trial: broad.Trial) -> Found:
    """Mean of the latest rest, in real time, as one knows it who is told the rests."""
    bias = np.zeros_like(trial.gyro)
    for rest in broad.rests(trial.moving, trial.rate_hz):
        bias[rest.start :] = trial.gyro[rest].mean(axis=0)
    return Found(bias)


def from_true_bias(trial: broad.Trial, *, through: bool, smoothed: bool = False) -> Found:
    """truerate's orientation from the true bias, and through the matrix that optics fits to this trial if so asked."""
    small = np.full(3, 1e-4)
    model = GyroModel(matrix_of([trial]) if through else np.eye(3), np.zeros(3), small, small, np.full(3, 2e-3))
    known = Correction(model, small, Quality.GOOD, "", 0.0).known
    rows = np.full((len(trial.gyro), 9), np.nan)
    rows[:, 0], rows[:, 1:4], rows[:, 4:7] = (
        np.arange(1, len(rows) + 1) / trial.rate_hz,
        trial.gyro - trial.bias,
        trial.accel,
    )
    rows[:, 7] = 0.0
    found, trace = Attitude().traced(rows, known)
    return Found(quat_wxyz=(smooth(found, trace, small) if smoothed else found).quat_wxyz)
