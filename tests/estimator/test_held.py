"""Samples that wait: none lost, none changed, however they come and go."""

import numpy as np
import pytest

from estimator.held import Held


@pytest.mark.parametrize("seed", range(5))
def test_what_comes_out_is_what_went_in_and_is_never_changed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 3000
    time, gyro, accel = np.arange(n) / 104, rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    clipped = rng.random(n) < 0.1
    held, drawn, put, out = Held(), [], 0, 0
    while out < n:
        more = slice(put, put + int(rng.integers(0, 700 if rng.random() < 0.05 else 20)))
        held.put(time[more], gyro[more], accel[more], clipped[more])
        put = min(n, more.stop)
        assert len(held) == put - out
        waiting = held.waiting
        np.testing.assert_array_equal(waiting[0], time[out:put])
        assert held.span == (time[put - 1] - time[out] if put > out else 0.0)
        take = int(rng.integers(0, len(held) + 1))
        drawn.append([column[:take] for column in waiting])
        held.drop(take)
        out += take
    times, reads, flags = (np.concatenate(column) for column in zip(*drawn, strict=True))
    np.testing.assert_array_equal(times, time)
    np.testing.assert_array_equal(reads, np.hstack([gyro, accel]))
    np.testing.assert_array_equal(flags, clipped)


def test_what_is_not_there_reads_nan_and_is_not_clipped() -> None:
    held, one = Held(), np.ones((2, 3))
    held.put(np.arange(2.0), one, None, None)
    held.put(np.arange(2.0, 4.0), 3 * one, one, np.ones(2, bool))
    _, read, clipped = held.waiting
    assert np.isnan(read[:2, 3:]).all()
    assert np.isfinite(read[2:]).all()
    assert clipped.tolist() == [False, False, True, True]
