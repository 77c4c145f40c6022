"""A velocity that lasts, told from one that is another each second."""

import numpy as np

from estimator.tracking.steady_motion import SteadyMotion

SAME, QUARTER = np.eye(3), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
AHEAD, VAR = np.array([0.6, 0.3, 0.0]), 0.25


def test_what_goes_on_is_believed_less_and_what_goes_to_and_fro_is_not() -> None:
    on, fro = SteadyMotion(), SteadyMotion()
    for i in range(120):
        on.heard(AHEAD, VAR, SAME, 1.0)
        fro.heard((-1) ** i * AHEAD, VAR, SAME, 1.0)
    assert on.factor > 10
    assert fro.factor == 1.0


def test_the_device_may_turn_meanwhile() -> None:
    """Innovations are in axes of the device: those of one direction on earth count."""
    lasting, ahead = SteadyMotion(), AHEAD
    for _ in range(120):
        ahead = QUARTER.T @ ahead
        lasting.heard(ahead, VAR, QUARTER, 1.0)
    assert lasting.factor > 10
