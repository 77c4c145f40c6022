import numpy as np
import pytest

from estimator.calibration.capture import Movement, Rest, Samples
from estimator.calibration.gravity_propagation import collect
from estimator.calibration.movements import MOST, Movements
from estimator.calibration.turn_recognition import TurnKnobs

UP = np.array([0.0, 0.0, 9.8])


def rest(start: float, end: float, bias: float = 0.0) -> Rest:
    return Rest(start, end, np.full(3, bias), np.full(3, 1e-3), np.full(3, 1e-9), 200, UP)


def movement(start: float, seconds: float = 2.0, *, bias: float = 0.0) -> Movement:
    """From a rest of 3 s that ends at `start` to one that has just settled."""
    time = np.arange(start - 0.4, start + seconds + 0.4, 0.01)
    turned = 0.5 * np.sin(np.pi * np.clip((time - start) / seconds, 0, 1))[:, None] * np.array([1.0, 0.0, 0.0])
    samples = Samples(time, turned, np.tile(UP, (len(time), 1)), np.zeros(len(time), bool))
    return Movement(rest(start - 3, start, bias), rest(start + seconds, start + seconds + 2, bias), samples)


def test_the_latest_are_kept_and_no_more() -> None:
    kept = Movements(TurnKnobs())
    for i in range(MOST + 10):
        assert kept.add(movement(5.0 * i + 5), full_turn=i % 2 == 0)
    assert len(kept) == MOST
    assert kept.all()[0].before.end == 5.0 * 10 + 5
    assert [m.full_turn for m in kept.all()[:2]] == [True, False]


@pytest.mark.parametrize("lost", [None, 1])
def test_a_rest_between_two_movements_is_one_rest(lost: int | None) -> None:
    # As stages see it: the rest after a movement is measured early, the same one before the next to its end.
    all_of = [movement(5.0 + 5.0 * i) for i in range(4)]
    data = collect([m for i, m in enumerate(all_of) if i != lost])
    if lost is None:
        assert data.links == ((0, 1), (1, 2), (2, 3), (3, 4))
        assert data.rests[1] is all_of[1].before
    else:
        assert data.links == ((0, 1), (2, 3), (3, 4))
    some = data.only([1, 2])
    assert some.links == ((0, 1), (1, 2)) if lost is None else ((0, 1), (1, 2))
    assert len(some.rests) == 3
