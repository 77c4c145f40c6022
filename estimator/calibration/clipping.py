"""Readings that were cut off at the end of the gyro's range, whether the range is known or not.

Known: readings at 99 % of it. A reading beyond it shows that the device is set to another range, which is then unknown.
Unknown: the largest reading of a movement comes up again and again, where a hand's fastest moment is passed once. The peak of
any smooth movement spends 1.45 times as long in the five steps below its highest step as in the highest step itself. A step
is the gyro's own. A matrix or a filter after the cut blurs the end of the range: then a step is a thousandth of the reading, and
readings there scatter less than the gyro does at rest.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from estimator.calibration.capture import Samples
from estimator.geometry.gyro_model import least_step

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class ClippingKnobs:
    """When readings count as cut off."""

    #: rad/s, full scale of a reading; infinite: not known
    gyro_range: float = inf
    #: part of the range from which on a reading is at its end, and beyond which the range is another one
    near: float = 0.99
    beyond: float = 1.02
    #: so many samples at the largest reading are needed, and so many times those in the five steps below it
    samples: int = 5
    times: float = 2.0
    #: of the largest reading, the step of a range whose end is blurred; and the most scatter there, of that at rest
    blur: float = 1e-3
    quieter: float = 0.5


def clipped(samples: Samples, noise_std: Floats, knobs: ClippingKnobs) -> Flags:
    """(n,) which samples of one movement were cut off, as the bridge says, by the range, or as the readings show.

    noise_std: (3,) rad/s, of one reading at rest.
    """
    known = at_range(samples, knobs)
    return known if known.any() else _repeated(samples.gyro, noise_std, knobs)


def at_range(samples: Samples, knobs: ClippingKnobs) -> Flags:
    """(n,) which samples were cut off, as the bridge says or by the range."""
    size = np.abs(samples.gyro)
    if not float(size.max(initial=0.0)) <= knobs.beyond * knobs.gyro_range < inf:
        return samples.clipped
    return np.asarray(samples.clipped | (size >= knobs.near * knobs.gyro_range).any(axis=1))


def _repeated(gyro: Floats, noise_std: Floats, knobs: ClippingKnobs) -> Flags:
    """(n,) the samples at the largest reading of readings (n, 3), if it is repeated as only the end of a range is."""
    at, axis = np.unravel_index(int(np.argmax(np.abs(gyro))), gyro.shape)
    reading = np.copysign(1.0, gyro[at, axis]) * gyro[:, axis]
    own, blurred = float(least_step(gyro)[axis]), knobs.blur * float(reading.max())
    ends = _end(reading, own, knobs)
    if not ends.any() and blurred > own:
        ends = _end(reading, blurred, knobs)
        if ends.any() and reading[ends].std() > knobs.quieter * noise_std[axis]:
            ends = np.zeros(len(gyro), bool)
    return ends


def _end(reading: Floats, step: float, knobs: ClippingKnobs) -> Flags:
    """(n,) which of readings (n,) are at the largest one, in steps; none where a smooth movement may have as many there."""
    below = (reading.max() - reading) / step
    at_the_end, just_below = below < 0.99, (below >= 0.99) & (below < 5.99)
    enough = np.count_nonzero(at_the_end) >= max(knobs.samples, knobs.times * np.count_nonzero(just_below) + 1)
    return at_the_end if enough else np.zeros(len(reading), bool)
