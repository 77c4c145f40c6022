"""Rate strips: minimum and maximum of |corrected rate| of each device between two frames. Pure."""

from collections.abc import Mapping, Sequence

import numpy as np

from bridge.wire.codec import Rates
from bridge.wire.messages import Floats


class Strips:
    """Reduces the rate batches of many devices to one frame: minimum and maximum rate of each device."""

    def take(self, batches: Sequence[Rates], numbers: Mapping[str, int]) -> Floats:
        """Return (n, 2) minimum and maximum of the rate's magnitude in °/s by device number; NaN for silent devices.

        numbers: number of each device; devices without a number are left out.
        """
        found = np.full((max(numbers.values(), default=-1) + 1, 2), np.nan)
        known = [batch for batch in batches if batch.device in numbers]
        if not known:
            return found
        rates = np.concatenate([batch.rate for batch in known])
        speed = np.sqrt(np.einsum("ij,ij->i", rates, rates))
        edges = np.cumsum([0, *(len(batch.rate) for batch in known[:-1])])
        least, most = np.minimum.reduceat(speed, edges), np.maximum.reduceat(speed, edges)
        where = np.array([numbers[batch.device] for batch in known])
        for column, values, keep in ((0, least, np.fmin), (1, most, np.fmax)):
            keep.at(found[:, column], where, np.degrees(values))
        return found
