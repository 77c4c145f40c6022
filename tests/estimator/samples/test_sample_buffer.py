"""Samples as columns, and the buffer that keeps them."""

from itertools import pairwise

import numpy as np
import pytest

from estimator.samples.sample_buffer import HOST_NS, SEQUENCE, SampleBuffer


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
