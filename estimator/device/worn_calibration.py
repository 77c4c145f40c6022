"""Worn calibration: matrix, bias and covariance estimated from gravity while the device is worn. Pure."""

from dataclasses import replace

import numpy as np

from bridge.reasons.codes import Code
from bridge.wire.messages import Calibration, Turn, Verdict
from estimator.calibration.gravity_propagation import COLUMN, MATRIX_PARAMETERS, ROW
from estimator.calibration.result import Result
from estimator.tracking.bias_state import BIAS, Floats
from estimator.tracking.evidence import GATES
from estimator.tracking.gravity import MATRIX
from estimator.tracking.tracker import Tracker

#: method name of such a calibration
METHOD = "worn"
_SCALE = slice(3, 6)


def learnt(tracker: Tracker, noise_std: Floats, turns: tuple[Turn, ...] = ()) -> Result:
    """Convert the tracker's bias (rad/s), and its matrix estimated from gravity, into a calibration result.

    noise_std (3,): white noise of a reading, rad/s. turns: those of a calibration by hand that this one continues.
    `tracker.taught` (the estimates from gravity) must not be None.
    """
    state, before = tracker.state, tracker.matrix
    change = state.x[MATRIX].reshape(3, 3)
    # An element of change times matrix, by the elements of change.
    slopes = np.zeros((12, len(state.x)))
    slopes[:3, BIAS] = np.eye(3)
    slopes[3:, MATRIX] = np.kron(np.eye(3), before.T)[3 * ROW + COLUMN]
    covariance = slopes @ state.P @ slopes.T
    return Result(
        METHOD,
        Verdict.ACCEPTED,
        (Code.LEARNT_WORN(),),
        before + change @ before,
        tracker.bias,
        (covariance + covariance.T) / 2,
        noise_std,
        turns,
        bias_time=tracker.time,
        parameters=MATRIX_PARAMETERS,
    )


def combined(by_hand: Result, worn: Calibration) -> Result:
    """Combine a calibration by hand with a worn calibration of the same boot, by a Kalman update of the matrix.

    The worn matrix is the prior, the three scale factors by hand are the measurement, both weighted by covariance. The
    bias is the one by hand.
    The calibration by hand is returned unchanged if the two disagree (NIS beyond the gate), or if it determined the
    whole matrix.
    """
    if len(by_hand.parameters) > 6 or len(worn.parameters) != len(MATRIX_PARAMETERS):
        return by_hand
    matrix, P = worn.matrix[ROW, COLUMN], worn.covariance[3:, 3:]
    R = by_hand.covariance[_SCALE, _SCALE]
    innovation, S = by_hand.scale - matrix[:3], P[:3, :3] + R
    gain = np.linalg.solve(S, P[:3]).T
    if innovation @ np.linalg.solve(S, innovation) > GATES[3]:
        return by_hand
    full, covariance = np.empty((3, 3)), np.zeros((12, 12))
    full[ROW, COLUMN] = matrix + gain @ innovation
    covariance[:3, :3], covariance[3:, 3:] = by_hand.covariance[:3, :3], P - gain @ P[:3]
    return replace(by_hand, matrix=full, covariance=covariance, parameters=MATRIX_PARAMETERS)
