"""Samples that wait: none lost, none changed, however they come and go."""

import numpy as np
import pytest

from estimator.held import Held


@pytest.mark.parametrize("seed", range(5))
def test_what_comes_out_is_what_went_in_and_is_never_changed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 3000
    rows, clipped = rng.normal(size=(n, 7)), rng.random(n) < 0.1
    held, drawn, put, out = Held(), [], 0, 0
    while out < n:
        more = slice(put, put + int(rng.integers(0, 700 if rng.random() < 0.05 else 20)))
        held.put(np.array_split(rows[more], rng.integers(1, 4)), clipped[more])
        put = min(n, more.stop)
        assert len(held) == put - out
        waiting = held.waiting
        np.testing.assert_array_equal(waiting[:, 0], rows[out:put, 0])
        take = int(rng.integers(0, len(held) + 1))
        drawn.append(waiting[:take])
        held.drop(take)
        out += take
    np.testing.assert_array_equal(np.concatenate(drawn), np.column_stack([rows, clipped]))


def test_nothing_is_clipped_where_nothing_is_said_to_be() -> None:
    held, one = Held(), np.ones((2, 7))
    held.put([one], None)
    held.put([one], np.ones(2, bool))
    assert held.waiting[:, 7].tolist() == [0, 0, 1, 1]
