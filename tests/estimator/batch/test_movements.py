from dataclasses import replace

import numpy as np
import pytest

from estimator.batch.capture import Movement, Rest, Samples
from estimator.batch.carry import collect
from estimator.batch.movements import LONGEST_S, MOST, STALE_S, Movements
from estimator.batch.recognise import TurnKnobs

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


def test_what_is_old_or_at_another_bias_goes() -> None:
    kept = Movements(TurnKnobs())
    kept.add(movement(5.0), full_turn=False)
    kept.add(movement(10.0), full_turn=False)
    kept.add(movement(13.0 + STALE_S), full_turn=False)
    assert len(kept) == 2
    kept.add(movement(20.0 + STALE_S, bias=0.05), full_turn=False)
    assert len(kept) == 1


def test_what_cannot_be_integrated_is_not_kept() -> None:
    whole = movement(5.0)
    n = len(whole.samples)
    gap = np.delete(np.arange(n), slice(n // 2, n // 2 + 20))
    s = whole.samples
    assert s.accel is not None
    broken = [
        replace(whole, samples=Samples(s.time[gap], s.gyro[gap], s.accel[gap], s.clipped[gap])),
        replace(whole, samples=replace(s, clipped=np.arange(n) == n // 2)),
        replace(whole, samples=s.between(5.1, 99.0)),
        replace(whole, after=replace(whole.after, accel=None)),
        replace(whole, after=replace(whole.after, bias=np.full(3, 0.02))),
        movement(5.0, LONGEST_S + 1),
        replace(whole, samples=replace(s, gyro=20 * s.gyro)),
    ]
    kept = Movements(TurnKnobs())
    assert [kept.add(m, full_turn=False) for m in broken] == [False] * len(broken)
    assert kept.add(whole, full_turn=False)


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
