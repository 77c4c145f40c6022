from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray

from estimator.tracking.seconds import Second
from estimator.tracking.tilt_check import ACCEL_FLOOR, G, TiltCheck


@dataclass
class OfGravity:
    """What a second tells of gravity at a time, tilted by so many rad."""

    start: float
    tilt: float
    samples: int = 100
    accel_std: NDArray[np.float64] = field(default_factory=lambda: np.full(3, 0.05))

    @property
    def end(self) -> float:
        return self.start

    @property
    def accel_mean(self) -> NDArray[np.float64]:
        return G * np.array([np.sin(self.tilt), 0.0, np.cos(self.tilt)])


def test_gravity_that_turns_within_the_last_while_is_seen() -> None:
    tilt = TiltCheck()

    def tells(now: float, angle: float) -> bool:
        return tilt.watch(cast("Second", OfGravity(now, angle)))

    error = np.sqrt(2 * (0.05**2 / 100 + ACCEL_FLOOR**2)) / G
    assert not any(tells(float(i), 3.9 * error * (i > 0)) for i in range(7))
    assert tells(7.0, 4.1 * error)
    assert tilt.seen
    # What came before is let go; after 5 s gravity has stayed.
    assert [(tells(8.0 + i, 4.1 * error), tilt.seen) for i in range(6)] == 4 * [(False, True)] + 2 * [(False, False)]
    assert tells(14.0, 0.0)
    # Slower than that within 10 s is not seen.
    slow = 3.9 * error / 11
    assert not any(tells(15.0 + i, slow * i) for i in range(60))
    assert any(tells(80.0 + i, 1.2 * slow * i) for i in range(60))
