"""Samples as columns, and the buffer that keeps them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bridge.wire.messages import SampleFlag
from estimator.device.samples import (
    ACCEL,
    CELSIUS,
    CLIPPED,
    FLAGS,
    GYRO,
    HOST_NS,
    SEQUENCE,
    TIME,
    SampleBuffer,
    Samples,
)
from tests.estimator.stream import calibration


def test_a_batch_becomes_columns() -> None:
    flags = np.zeros(10, np.uint32)
    flags[2], flags[4], flags[7] = SampleFlag.CLIPPED, SampleFlag.TEMPERATURE_STEP, SampleFlag.STUCK
    batch = replace(calibration(seed=1).batches()[3], flags=flags, clock_rate=1.5)
    samples = Samples.of(batch)
    np.testing.assert_array_equal(samples.rows[:, TIME], batch.device_time)
    np.testing.assert_array_equal(samples.rows[:, GYRO], batch.gyro)
    np.testing.assert_array_equal(samples.rows[:, ACCEL], batch.accel)
    assert np.flatnonzero(samples.rows[:, CLIPPED]).tolist() == [2, 7]
    assert np.flatnonzero(np.isnan(samples.rows[:, CELSIUS])).tolist() == [4]
    np.testing.assert_array_equal(samples.places[:, SEQUENCE], 30 + np.arange(10))
    assert np.abs(samples.places[:, HOST_NS] - batch.sample_time_ns).max() <= 1
    np.testing.assert_array_equal(samples.places[:, FLAGS], flags)
    bare = Samples.of(replace(batch, accel=None, temperature_c=None))
    assert np.isnan(bare.rows[:, ACCEL]).all()
    assert bare.celsius is None
    part = samples.part(3, 8)
    assert (part.sequence, part.n, part.first_s, part.last_s) == (33, 5, batch.device_time[3], batch.device_time[7])
    assert part.ticks == batch.ticks[3:8].tobytes()


@pytest.mark.parametrize("seed", range(5))
def test_what_comes_out_of_a_buffer_is_what_went_in_and_is_never_changed(seed: int) -> None:
    rng, buffer = np.random.default_rng(seed), SampleBuffer()
    rows, places = rng.normal(size=(3000, 9)), rng.integers(0, 2**62, (3000, 3))
    put, needed, read = 0, 0, []
    while put < len(rows):
        end = min(len(rows), put + int(rng.integers(1, 700 if rng.random() < 0.05 else 20)))
        cuts = [put, *sorted(rng.integers(put, end, 2).tolist()), end]
        buffer.put([(rows[a:b], places[a:b]) for a, b in pairwise(cuts)])
        put = end
        assert buffer.end == put
        read.append((needed, put, buffer.rows(needed, put)))
        np.testing.assert_array_equal(buffer.places(needed, put), places[needed:put])
        number = int(rng.integers(needed, put))
        assert buffer.place(number) == (places[number, SEQUENCE], places[number, HOST_NS])
        needed = int(rng.integers(needed, put + 1))
        buffer.forget(needed)
    for begin, end, view in read:
        np.testing.assert_array_equal(view, rows[begin:end])


def test_a_sample_that_is_forgotten_is_not_found() -> None:
    buffer = SampleBuffer()
    buffer.put([(np.zeros((20, 9)), np.zeros((20, 3), np.int64))])
    buffer.forget(13)
    assert buffer.place(13) == (0, 0)
    for number in (12, 20):
        with pytest.raises(IndexError, match=f"sample {number} is not in the buffer: 13 to 19 are"):
            buffer.place(number)
