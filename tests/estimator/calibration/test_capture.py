"""What is kept of a stream: the same samples, however they were handed in."""

import numpy as np
import pytest

from estimator.calibration.capture import History, Samples
from estimator.stillness.detector import Stillness, Window
from tests.estimator.stream import Stream, calibration

OF = calibration(seed=3)


def windows(of: Stream, *, aided: bool) -> list[Window]:
    clipped = np.arange(len(of)) % 50 == 7
    return list(Stillness().feed(of.time, of.gyro, of.accel if aided else None, clipped))


def same(a: Samples, b: Samples) -> None:
    assert (a.accel is None) == (b.accel is None)
    for name in ("time", "gyro", "accel", "clipped"):
        found, expected = getattr(a, name), getattr(b, name)
        np.testing.assert_array_equal(found, expected)
        # Sums depend on how numbers lie in memory, to the last bit.
        assert found is None or found.flags.c_contiguous


@pytest.mark.parametrize("aided", [True, False])
def test_windows_are_kept_as_their_samples_are(*, aided: bool) -> None:
    found, one, other, whole = windows(OF, aided=aided), History(20.0), History(20.0), History()
    for i, window in enumerate(found):
        one.take(window.rows)
        other.add(Samples.of([window]))
        if i % 40 == 39:
            for start, end in ((-np.inf, np.inf), (window.end_time - 7.03, window.start_time), (-2.0, -1.0)):
                same(one.between(start, end), other.between(start, end))
    whole.add(Samples.of(found))
    end = found[-1].end_time
    assert len(one.between(-np.inf, end)) < len(whole.between(-np.inf, end))
    same(one.between(end - 15.0, end), whole.between(end - 15.0, end))
