"""Repeats, losses and silences."""

import numpy as np

from bridge.wire.messages import Quality, State
from estimator.device.session import DeviceSession
from tests.estimator.device.session.lives import calibrated, state
from tests.estimator.stream import NAME, Stream, feed
from tests.sentences import free


def test_a_lost_device_is_not_good_and_comes_back(once: Stream) -> None:
    device = calibrated(once.part(0, once.at(40.0)))
    assert device.silence(free("no samples for 3 s"))
    assert not device.silence(free("no samples for 4 s")), "no news"
    assert device.status(1).reason == free("no samples for 4 s")
    assert (device.status(1).state, device.status(1).quality) == (State.LOST, Quality.DEGRADED)
    assert device.recalibrate("nurse", "") is not None
    start = once.at(43.0)
    outcome = feed(device, once.part(start, len(once)).batches(first=start))
    assert outcome.said[0] == "heard again"
    assert state(device) is State.TRACKING
    assert outcome.corrected[-1].quality is Quality.GOOD
    assert device.status(1).events["missing_samples"] == start - once.at(40.0)


def test_one_percent_of_lost_batches_in_the_rests_does_no_harm(once: Stream) -> None:
    still = np.linalg.norm(once.rate, axis=1) == 0
    rng = np.random.default_rng(0)
    kept = [b for b in once.batches() if not (still[b.sequence : b.sequence + len(b)].all() and rng.random() < 0.01)]
    device = DeviceSession(NAME)
    outcome = feed(device, kept)
    assert outcome.calibration is not None
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), once.truth.k, atol=2e-4)
    assert device.status(1).events["missing_samples"] == len(once) - sum(map(len, kept))
