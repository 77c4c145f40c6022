"""Detection of clipped gyro readings: readings at the limit of a known or unknown full-scale range.

Known range: readings from 99 % of the range are clipped. A reading above 102 % shows that the device uses another
range, which is then unknown.
Unknown range: if a movement is clipped, its largest reading occurs many times. An unclipped turn by hand is at its
largest rate only briefly.
The test compares the number of samples at the largest reading with the number in the five rounding steps below it. In a
smooth movement without clipping, those five steps hold 1.45 times as many samples.
A filter or a matrix after the clipping blurs the limit. The test is then repeated with a step of a thousandth of the
largest reading. It also demands that these readings scatter less than half as much as the gyro does at rest.
"""

from math import inf

import numpy as np
from numpy.typing import NDArray

from estimator.calibration.capture import Samples
from estimator.geometry.gyro_model import Floats, least_step

Flags = NDArray[np.bool_]

#: share of the range from which a reading is clipped, and beyond which the device uses another range
_NEAR, _BEYOND = 0.99, 1.02
#: least number of samples at the largest reading, and least ratio to those in the five steps below it. With 5 samples one
#: smooth turn in 2000 looks clipped. Seven clipped samples lose 0.006 degrees of a turn of 3.5 s at 104 Hz, and 0.3
#: degrees of one of 2 s at 50 Hz
_SAMPLES, _TIMES = 8, 2.0
#: blurred end of the range: step over the largest reading; and largest scatter there, over that at rest
_BLUR, _QUIETER = 1e-3, 0.5


def clipped(samples: Samples, noise_std: Floats, gyro_range: float) -> Flags:
    """Flags (n,) of the clipped samples of one movement: True where a reading is at the limit of the full-scale range.

    samples: the movement; its `clipped` holds a flag for each sample, set by the bridge.
    noise_std (3,): standard deviation of one gyro reading at rest, rad/s.
    gyro_range: full-scale range, rad/s; infinite when unknown.
    A sample is clipped if its flag is set, or if a reading is at the known range. If no sample of the movement is
    clipped by this rule, the repetition of the largest reading is tested (see the module).
    """
    known = at_range(samples, gyro_range)
    return known if known.any() else _repeated(samples.gyro, noise_std)


def at_range(samples: Samples, gyro_range: float) -> Flags:
    """Flags (n,) of clipped samples, from the flags in `samples` and the known full-scale range; True means clipped.

    gyro_range: full-scale range, rad/s; infinite when unknown.
    """
    size = np.abs(samples.gyro)
    if not float(size.max(initial=0.0)) <= _BEYOND * gyro_range < inf:
        return samples.clipped
    return np.asarray(samples.clipped | (size >= _NEAR * gyro_range).any(axis=1))


def _repeated(gyro: Floats, noise_std: Floats) -> Flags:
    """Flags (n,) of the samples at the largest of readings (n, 3), if it repeats as only the end of a range does."""
    at, axis = np.unravel_index(int(np.argmax(np.abs(gyro))), gyro.shape)
    reading = np.copysign(1.0, gyro[at, axis]) * gyro[:, axis]
    own, blurred = float(least_step(gyro)[axis]), _BLUR * float(reading.max())
    ends = _end(reading, own)
    if not ends.any() and blurred > own:
        ends = _end(reading, blurred)
        if ends.any() and reading[ends].std() > _QUIETER * noise_std[axis]:
            ends = np.zeros(len(gyro), bool)
    return ends


def _end(reading: Floats, step: float) -> Flags:
    """Flags (n,) of the readings (n,) at the largest one, within a step; none where a smooth movement may have as many there."""
    below = (reading.max() - reading) / step
    at_the_end, just_below = below < 0.99, (below >= 0.99) & (below < 5.99)
    enough = np.count_nonzero(at_the_end) >= max(_SAMPLES, _TIMES * np.count_nonzero(just_below) + 1)
    return at_the_end if enough else np.zeros(len(reading), bool)
