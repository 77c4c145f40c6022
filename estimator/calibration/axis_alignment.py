"""Check that the gyro's axes match the accelerometer's: gravity propagated by the gyro against measured gravity.

A full turn by a gyro with mirrored or swapped axes also appears to end in its start attitude. Gravity during the turn
tells the difference. The check therefore needs an accelerometer.
The misfit of a movement is the mean squared difference between propagated and measured gravity. It is computed for all
48 signed permutations of the axes.
The score of a permutation is the sum of the logarithms of its misfits over all movements. The logarithm keeps a
vigorous movement from outweighing a calm one. A turn about the vertical carries no information.
"""

import itertools
from collections.abc import Sequence

import numpy as np
import scipy

from bridge.reasons.codes import Code, Sentence
from estimator.calibration.capture import Rest, Samples
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES, Floats

#: (48, 3, 3) all signed permutations of the axes, the identity first
MAPPINGS: Floats = np.array(
    sorted(
        (
            np.eye(3)[list(order)] * np.array(signs)[:, None]
            for order in itertools.permutations(range(3))
            for signs in itertools.product((1.0, -1.0), repeat=3)
        ),
        key=lambda mapping: -np.trace(mapping),
    )
)
_STEP_S = 0.04
#: regularisation: keeps an offset small where a movement hardly shows it
_UNKNOWN = 1e-3
#: misfit (of gravity squared) below which differences are noise
_FLOOR = 3e-4
#: least lead of another mapping, in natural logarithms over all movements. Where the only turn about an axis was
#: vertical and steady, the axis and its mirror image fit alike, except for up to 0.7 from forces on a sensor off the
#: centre of a fast turn.
#: Elsewhere the correct mapping leads by 2 or more.
_LEAD = 1.0


def foreign_axes(movements: Sequence[tuple[Rest, Samples]], matrix: Floats) -> Sentence | None:
    """Return the reason text if the gyro's axes differ from the accelerometer's.

    movements: pairs of the rest before a movement and the samples of the movement.
    matrix (3, 3): gyro matrix, no unit: rate = matrix (reading - bias), in the gyro's axes.
    Returns None if the axes match, or if the data cannot decide.
    """
    seen = [(rest, samples) for rest, samples in movements if rest.accel is not None and _moves(samples.accel)]
    if not seen:
        return None
    score = sum((np.log(misfit(rest, samples, matrix) + _FLOOR) for rest, samples in seen), np.zeros(len(MAPPINGS)))
    best = int(np.argmin(score))
    if score[0] - score[best] < _LEAD:
        return None
    return Code.AXES_DIFFER(mapping=in_words(MAPPINGS[best]))


def misfit(rest: Rest, samples: Samples, matrix: Floats) -> Floats:
    """Misfit (48,) of each axis mapping: mean squared difference of propagated and measured gravity, over gravity squared.

    The result has no unit. Its order is that of MAPPINGS, the identity first.
    rest: the rest before the movement.
    samples: gyro (rad/s) and accelerometer (m/s²) readings of the movement.
    matrix (3, 3): gyro matrix, no unit: rate = matrix (reading - bias).
    Raises ValueError without accelerometer readings.
    Each mapping is fitted with its own constant accelerometer offset o (3,), m/s². The model is measured = C a + (I -
    C) o. Here a (3,) is the reading at rest, m/s², and C (3, 3) rotates it into the present sensor axes.
    """
    if rest.accel is None or samples.accel is None:
        raise ValueError("gravity cannot be measured without an accelerometer: give accelerometer readings")
    dt = rotation.intervals(samples.time)
    block = max(1, round(_STEP_S / float(np.median(dt))))
    n = len(samples) // block
    turned = ((samples.gyro - rest.bias) @ matrix.T * dt[:, None])[: n * block].reshape(n, block, 3).sum(axis=1)
    measured = samples.accel[: n * block].reshape(n, block, 3).mean(axis=1)
    vectors = np.einsum("mij,tj->mti", MAPPINGS, turned).reshape(-1, 3)
    steps = scipy.spatial.transform.Rotation.from_rotvec(vectors).as_matrix().reshape(len(MAPPINGS), n, 3, 3)
    turn = np.broadcast_to(np.eye(3), (len(MAPPINGS), 3, 3))
    by_offset, both, total = np.zeros((len(MAPPINGS), 3, 3)), np.zeros((len(MAPPINGS), 3)), np.zeros(len(MAPPINGS))
    for t in range(n):
        turn = np.einsum("mji,mjk->mik", steps[:, t], turn)  # takes a fixed vector to the body frame one step later
        missed, slope = measured[t] - turn @ rest.accel, np.eye(3) - turn
        by_offset += slope.swapaxes(1, 2) @ slope
        both += np.einsum("mij,mi->mj", slope, missed)
        total += np.sum(missed**2, axis=1)
    offset = np.linalg.solve(by_offset + _UNKNOWN * n * np.eye(3), both[..., None])[..., 0]
    total -= np.sum(offset * (2 * both - np.einsum("mij,mj->mi", by_offset, offset)), axis=1)
    return np.asarray(total / n / (rest.accel @ rest.accel))


def _moves(accel: Floats | None) -> bool:
    """Return whether there is an accelerometer whose readings change; a frozen one has constant readings."""
    return accel is not None and bool(np.ptp(accel, axis=0).any())


def in_words(mapping: Floats) -> str:
    """Format an axis mapping (3, 3) as text for users, such as `x = −y, y = x`.

    mapping: a signed permutation matrix. Axes that do not change are left out.
    """
    rows = [int(np.argmax(np.abs(row))) for row in mapping]
    signs = ["−" if mapping[axis, row] < 0 else "" for axis, row in enumerate(rows)]
    changed = [
        f"{AXES[axis]} = {signs[axis]}{AXES[row]}" for axis, row in enumerate(rows) if row != axis or signs[axis]
    ]
    return ", ".join(changed)
