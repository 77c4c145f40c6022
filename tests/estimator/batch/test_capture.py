"""What is kept of a stream: the same samples, however they were handed in."""

import numpy as np
import pytest

from estimator.batch.capture import History, Samples
from estimator.stillness import Stillness, Window
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


def test_a_stretch_without_an_accelerometer_in_a_part_of_it_has_none() -> None:
    with_it, without = windows(OF, aided=True), windows(OF, aided=False)
    history = History()
    for window in (*with_it[:20], *without[20:40]):
        history.take(window.rows)
    assert history.between(with_it[0].start_time, with_it[19].end_time).accel is not None
    assert history.between(with_it[0].start_time, with_it[20].start_time).accel is None


def test_whether_there_was_an_accelerometer_is_seen_in_the_rows_as_a_window_says_it() -> None:
    rng, accel, told = np.random.default_rng(5), OF.accel.astype(float), set()
    for axis, value in ((0, np.nan), (1, np.nan), (0, np.inf), (0, -np.inf)):
        accel[rng.integers(0, len(OF), 60), axis] = value
    with np.errstate(invalid="ignore"):
        for window in Stillness().feed(OF.time, OF.gyro, accel):
            history = History()
            history.take(window.rows)
            told.add(window.aided)
            assert (history.between(-np.inf, np.inf).accel is not None) == window.aided
    assert told == {True, False}


def test_the_largest_reading_is_known_whichever_way_it_went() -> None:
    history, (window, *more) = History(), windows(OF, aided=True)
    assert history.largest == 0.0
    window.rows[3, 2] = -70.0
    for one in (window, *more):
        history.take(one.rows)
    assert history.largest == 70.0
