"""Attitude of a device, sample by sample: gyro strapdown, levelled by gravity, with a covariance of its error.

Earth axes: z up, x and y horizontal. The heading counts from its zero: the start of the attitude, or the last reset.
Without an accelerometer the attitude is relative to that of the first sample.

Levelling: the specific force is averaged in earth axes, which turn with the gyro's errors only (D. Laidig and T. Seel,
"VQF: Highly accurate IMU orientation estimation with bias estimation and magnetic disturbance rejection", Information
Fusion 91 (2023), eqs. 4 to 10). VQF uses a fixed low-pass filter. Here a Kalman filter of tilt and velocity measures
the wearer's velocity as zero instead. The variance of this measurement grows with the motion, as in
tracking/gravity.py. The filter gain is computed for a typical gyro.

Covariance: the effect of this gain on the errors of the actual gyro. Bias, matrix and accelerometer bias are constant
unknowns. The filter propagates the sensitivity of the attitude to each of them ("consider" states, S. F. Schmidt,
"Application of state-space methods to navigation problems", Advances in Control Systems 3 (1966)). The noise uses
Joseph's form.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.geometry.gyro_model import GyroModel
from estimator.kernels import orientation as loop
from estimator.state import Floats, shaped

#: m/s²
G = 9.80665
_ROWS, _COLUMNS = np.triu_indices(3)


#: m/s, standard deviation of a wearer's velocity averaged over a second: without motion, and for each m/s of motion
_SPEED, _SPEED_PER_UNREST = 0.05, 0.5
#: s, over which motion is measured
_SWING_S = 2.0
#: rad per root second, for each rad/s: gyro errors that grow with the rate (0.3 %, kept for a second)
_RATE_SHARE = 2.75e-3
#: rad per root second: other gyro errors
_DRIFT = 5e-4
#: m/s per root second: accelerometer noise
_PUSH = 0.01
#: rad and m/s, standard deviation of the first tilt and the first velocity
_FIRST_TILT, _FIRST_SPEED = 1.0, 0.5
#: s, for which a bias flicker lasts
_FLICKER_S = 100.0
#: rad/s, error of the guessed rate while samples are missing, beside a quarter of the rates before and after
_UNSEEN_RATE = 0.02
#: s without samples after which the rotation in between counts as unknown
_LOST_S = 1.0
#: in the order in which the kernel unpacks them
_SETTINGS = np.array(
    [
        *(_SPEED, _SPEED_PER_UNREST, _SWING_S, _RATE_SHARE, _DRIFT, _PUSH),
        *(_FIRST_TILT, _FIRST_SPEED, _FLICKER_S, _UNSEEN_RATE, _LOST_S),
    ]
)


class Oriented(NamedTuple):
    """Attitudes of n samples, with acceleration and covariance.

    quat_wxyz (n, 4): rotation from sensor to earth axes, scalar first.
    accel (n, 3): acceleration without gravity in earth axes, m/s²; NaN without an accelerometer.
    cov (n, 6), or (1, 6) for the last sample only: covariance xx, xy, xz, yy, yz, zz of the attitude error, rad². The
    error is a small rotation in earth axes from the estimated to the true attitude.
    """

    quat_wxyz: Floats
    accel: Floats
    cov: Floats

    @property
    def tilt_std(self) -> Floats:
        """Rms angle between the true and the estimated vertical, rad, (n,) or (1,) as `cov`."""
        return np.asarray(np.sqrt(self.cov[:, 0] + self.cov[:, 3]))

    @property
    def heading_std(self) -> Floats:
        """Standard deviation of the heading since its zero, rad, (n,) or (1,) as `cov`."""
        return np.asarray(np.sqrt(self.cov[:, 5]))

    @property
    def rotation(self) -> Rotation:
        """Rotations of the n samples from sensor to earth axes; `rotation.apply(v)` gives sensor vectors in earth axes."""
        return Rotation.from_quat(self.quat_wxyz, scalar_first=True)


def known(model: GyroModel, bias_std: Floats, std: Floats, flicker: float, walk: float, accel: Floats) -> Floats:
    """Pack a gyro model, sensor errors and their uncertainties into one array (38,), the input of `Attitude`.

    bias_std (3,): standard deviation of the bias, rad/s. flicker: that of the bias instability, rad/s.
    std (12,): standard deviations of the matrix (9, relative, by rows) and of the accelerometer bias (3, m/s²).
    walk: rate random walk, rad/s per root second.
    accel (6,): bias (3, m/s²) and scale (3) of the accelerometer: corrected = scale (reading - bias).
    """
    return np.concatenate([model.matrix.ravel(), model.bias, bias_std, std, model.noise_std, [flicker, walk], accel])


class Attitude:
    """Attitude of one device in one boot, integrated sample by sample.

    state (120,): the complete state, which may be saved and passed again; None begins a new attitude.
    zero: reason for the zero of the heading: `start`, or the name of the person who reset it.
    Raises ValueError for a damaged state.
    """

    def __init__(self, state: Floats | None = None, zero: str = "start") -> None:
        self.zero = zero
        self.state = np.zeros(loop.SIZE)
        self.state[loop.TIME] = np.nan
        if state is not None:
            shaped(state, loop.SIZE)
            if not np.isfinite(state[1:]).all():
                raise ValueError("damaged state: an attitude is not finite; start without this state")
            self.state = state.copy()

    @property
    def begun(self) -> bool:
        """True if the attitude has begun: at least one sample was taken."""
        return not np.isnan(self.state[loop.TIME])

    @property
    def rotation(self) -> Rotation:
        """Rotation from sensor to earth axes at the last sample."""
        return Rotation.from_quat(self.state[loop.QUAT : loop.VELOCITY], scalar_first=True)

    @property
    def heading(self) -> float:
        """Heading since its zero, rad, -π to π: the rotation about the vertical that remains after removing the tilt."""
        w, _, _, z = self.state[loop.QUAT : loop.VELOCITY].tolist()
        return float(np.arctan2(2 * w * z, w * w - z * z))

    @property
    def cov(self) -> Floats:
        """Covariance (3, 3) of the attitude error at the last sample, rad²; the error is a small rotation in earth axes."""
        cov = np.empty((3, 3))
        cov[_ROWS, _COLUMNS] = cov[_COLUMNS, _ROWS] = self.state[loop.COV : loop.COV + 6]
        return cov

    def take(self, rows: Floats, known: Floats) -> Oriented:
        """Integrate the attitude over n samples; return attitude, acceleration (m/s²) and covariance (rad²) at each.

        rows (n, 9): device time (s), gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
        known (38,): sensor errors, result of the function `known`.
        """
        return orient([(self, rows, known)], every=True)[0]

    def traced(self, rows: Floats, known: Floats) -> tuple[Oriented, Floats]:
        """Integrate the attitude over n samples as `take` does; also return the trace (n, 11), the input of `smoothing.smooth`.

        The trace holds the covariances and corrections of the filter at each sample; kernels/orientation.py lists its
        columns (`smoothed`).
        """
        trace = np.empty((len(rows), loop.TRACE))
        return _carry([(self, rows, known)], trace, every=True)[0], trace

    def reset_heading(self, zero: str = "") -> None:
        """Set the heading of the last sample to zero, with zero variance.

        zero: name of the person who resets it; it is shown to users as the reason for the zero.
        """
        self.zero, self.state[loop.ZERO] = zero, self.state[loop.NEXT] - 1
        s, turn = self.state, Rotation.from_euler("z", -self.heading)
        matrix = turn.as_matrix()
        s[loop.QUAT : loop.VELOCITY] = (turn * self.rotation).as_quat(scalar_first=True)
        for part in (loop.VELOCITY, loop.SWING):
            s[part : part + 2] = matrix[:2, :2] @ s[part : part + 2]
        by = s[loop.BY : loop.VAR].reshape(5, 15)
        by[:3] = matrix @ by[:3]
        by[3:] = matrix[:2, :2] @ by[3:]
        by[2], s[loop.HEADING] = 0.0, 0.0
        cov = matrix @ self.cov @ matrix.T
        cov[2, :] = cov[:, 2] = 0.0
        s[loop.COV : loop.COV + 6] = cov[_ROWS, _COLUMNS]


def orient(due: Sequence[tuple[Attitude, Floats, Floats]], *, every: bool = False) -> list[Oriented]:
    """Integrate attitudes over samples of any number of devices, in one compiled loop; return one result per element.

    due: elements (attitude, rows (n, 9), known (38,)), as for `Attitude.take`. A device may come several times, in the
        order of time.
    every: True for the covariance (rad²) at each sample, False for that at the last sample of each element.
    The results are the same to the last bit, however the samples are split into calls.
    """
    return _carry(due, np.empty((0, loop.TRACE)), every=every) if due else []


def _carry(due: Sequence[tuple[Attitude, Floats, Floats]], trace: Floats, *, every: bool) -> list[Oriented]:
    places = dict[Attitude, int]()
    which = np.array([places.setdefault(attitude, len(places)) for attitude, _, _ in due])
    states = np.concatenate([attitude.state for attitude in places]).reshape(-1, loop.SIZE)
    rows = np.concatenate([rows for _, rows, _ in due])
    counts = np.array([len(rows) for _, rows, _ in due])
    out, cov = np.empty((len(rows), loop.WIDTH)), np.empty((len(rows) if every else len(due), 6))
    loop.carried(
        states,
        which,
        rows,
        counts,
        np.concatenate([known for _, _, known in due]).reshape(-1, loop.KNOWN),
        _SETTINGS,
        out,
        cov,
        trace,
    )
    for attitude, state in zip(places, states, strict=True):
        attitude.state = state
    quaternions, accel = out[:, : loop.RESULT_ACCEL], out[:, loop.RESULT_ACCEL :]
    parts = [slice(begin, end) for begin, end in pairwise([0, *np.cumsum(counts).tolist()])]
    covs = [cov[part] for part in parts] if every else cov[:, None]
    return [Oriented(quaternions[part], accel[part], one) for part, one in zip(parts, covs, strict=True)]
