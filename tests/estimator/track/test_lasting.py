"""A velocity that lasts, told from one that is another each second."""

import numpy as np
import pytest

from estimator.track.lasting import Lasting, LastingKnobs

SAME, QUARTER = np.eye(3), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
AHEAD, VAR = np.array([0.6, 0.3, 0.0]), 0.25


def test_what_is_another_each_second_is_believed_as_it_is() -> None:
    lasting, rng = Lasting(), np.random.default_rng(0)
    for _ in range(600):
        lasting.heard(0.3 * rng.normal(size=3), VAR, SAME, 1.0)
        assert lasting.factor == 1.0


def test_what_goes_on_is_believed_less_and_what_goes_to_and_fro_is_not() -> None:
    on, fro = Lasting(), Lasting()
    for i in range(120):
        on.heard(AHEAD, VAR, SAME, 1.0)
        fro.heard((-1) ** i * AHEAD, VAR, SAME, 1.0)
    assert on.factor > 10
    assert fro.factor == 1.0


def test_the_device_may_turn_meanwhile() -> None:
    """Innovations are in axes of the device: those of one direction on earth count."""
    lasting, ahead = Lasting(), AHEAD
    for _ in range(120):
        ahead = QUARTER.T @ ahead
        lasting.heard(ahead, VAR, QUARTER, 1.0)
    assert lasting.factor > 10


def test_it_is_forgotten_when_the_walk_is_over() -> None:
    lasting, rng = Lasting(), np.random.default_rng(0)
    for _ in range(120):
        lasting.heard(AHEAD, VAR, SAME, 1.0)
    for _ in range(300):
        lasting.heard(0.1 * rng.normal(size=3), VAR, SAME, 1.0)
    assert lasting.factor == 1.0


def test_one_fall_is_no_walk_and_a_break_has_no_neighbour() -> None:
    lasting = Lasting()
    for _ in range(2):
        lasting.heard(100 * AHEAD, VAR, SAME, 1.0)
    assert lasting.factor == 1.0
    for _ in range(120):
        lasting.heard(AHEAD, VAR, SAME, 1.0)
        lasting.broken()
    assert lasting.factor == 1.0


def test_it_has_a_most() -> None:
    lasting = Lasting()
    for _ in range(600):
        lasting.heard(10 * AHEAD, VAR, SAME, 1.0)
    assert lasting.factor == pytest.approx(LastingKnobs().most)
