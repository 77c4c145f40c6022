"""A device whose bias is only predicted for a while: its samples go on, less sure; its calibration does not wait."""

import numpy as np

from bridge.wire.messages import Quality, State
from estimator.learnt import COASTED
from estimator.session import DeviceSession
from estimator.track.bias_filter import BiasKnobs
from tests.estimator.session.lives import calibrated, off, state
from tests.estimator.stream import NAME, Stream, calibration, feed

WALK = BiasKnobs().rate_random_walk


def test_a_bias_is_as_sure_as_its_walk_leaves_it_and_learns_again(once: Stream) -> None:
    device, rest = calibrated(once), off(once, 0.0, 80.0)
    batches = rest.batches(first=len(once))
    tracker, before = device.tracker, device.tracker.std
    device.coasts = True
    half = len(batches) // 2
    outcome = feed(device, batches[:half])
    seconds = tracker.time - once.time[-1]
    assert 38.0 < seconds < 41.0
    assert sum(map(len, outcome.corrected)) == sum(map(len, batches[:half]))
    assert all(batch.quality is Quality.GOOD for batch in outcome.corrected)
    assert (tracker.std**2 >= before**2 + 0.99 * WALK**2 * seconds).all()
    assert (tracker.std < 1.5 * before).all(), "it became warmer by half a kelvin, too"
    assert device.sequence.events.as_dict()[COASTED] >= 0.95 * sum(map(len, batches[:half]))
    assert (np.abs(tracker.bias - once.bias[0]) < 4 * tracker.std).all()
    unsure, device.coasts = tracker.std, False
    outcome = feed(device, batches[half:])
    assert (tracker.std < unsure).all()
    assert (np.abs(tracker.bias - once.bias[0]) < 4 * tracker.std).all()
    assert outcome.revisions, "that time is known better then"
    assert state(device) is State.TRACKING


def test_who_coasts_is_calibrated_all_the_same() -> None:
    stream, usual, coasts = calibration(seed=2), DeviceSession(NAME), DeviceSession(NAME)
    for batch in stream.batches():
        coasts.coasts = True
        feed(usual, [batch])
        feed(coasts, [batch])
    assert coasts.sequence.events.as_dict()[COASTED] > 100
    assert usual.calibration is not None
    assert coasts.calibration is not None
    np.testing.assert_array_equal(coasts.calibration.matrix, usual.calibration.matrix)
    np.testing.assert_array_equal(coasts.calibration.bias, usual.calibration.bias)


def test_a_bias_that_is_not_known_does_not_coast(once: Stream) -> None:
    new = DeviceSession(NAME)
    new.coasts = True
    feed(new, off(once, 0.0, 0.4).batches())
    assert not new.learnt.may_coast
    assert COASTED not in new.sequence.events.as_dict()


def test_a_bias_in_doubt_does_not_coast(once: Stream) -> None:
    device = calibrated(once)
    device.tracker.doubt.why = "it was in doubt"
    device.coasts = True
    feed(device, off(once, 0.0, 5.0).batches(first=len(once)))
    assert COASTED not in device.sequence.events.as_dict()
