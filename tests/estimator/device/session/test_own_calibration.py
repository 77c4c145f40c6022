"""A calibration that the device made itself: when it is used, and what it never replaces."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import DeviceCalibration, Quality, State, Verdict
from estimator.device.own_calibration import METHOD
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import OWN_REFUSED, DeviceSession
from tests.estimator.device.session.lives import again, calibrated, state
from tests.estimator.stream import NAME, Stream, feed, stream
from tests.sentences import codes


@pytest.fixture(scope="module")
def resting() -> Stream:
    return stream([Still(30.0)], 30.0, seed=4)


def own(of: Stream, *, boot: int = 1, sequence: int = 7) -> DeviceCalibration:
    """What a device finds that makes no error."""
    return DeviceCalibration(boot, sequence, tuple(of.truth.k.tolist()), tuple(of.bias[0].tolist()))


def test_it_is_used_from_the_next_sample_on(resting: Stream) -> None:
    device, batches = DeviceSession(NAME), resting.batches()
    feed(device, batches[:200])
    assert state(device) is State.BIAS_ONLY
    outcome = device.offered(own(resting), 5)
    assert [c.verdict for c in outcome.calibrations] == [Verdict.ACCEPTED]
    assert state(device) is State.TRACKING
    assert codes(device.life.reason) == ["calibrated", "own_accepted"]
    [first, *_] = feed(device, batches[200:]).corrected
    assert first.quality is Quality.GOOD, "rests have shown its bias already"
    np.testing.assert_allclose(device.applied.model.matrix.diagonal(), resting.truth.k)


def test_before_a_rest_has_shown_the_bias_it_is_not_good_yet(resting: Stream) -> None:
    device, batches = DeviceSession(NAME), resting.batches()
    feed(device, batches[:2])
    device.offered(own(resting), 5)
    corrected = feed(device, batches[2:]).corrected
    assert corrected[0].quality is Quality.DEGRADED
    assert corrected[-1].quality is Quality.GOOD


def test_it_never_replaces_turns_made_here(once: Stream) -> None:
    device = calibrated(once)
    by_hand = device.calibration
    assert not device.offered(own(once), 5).calibrations
    assert device.calibration is by_hand


def test_turns_made_here_replace_it(resting: Stream, once: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, once.batches()[:2])
    device.offered(own(once), 5)
    device.recalibrate("nurse", "")
    assert not device.offered(own(once, sequence=99), 6).calibrations, "somebody has asked for turns"
    outcome = feed(device, again(once).batches(first=len(once)))
    assert outcome.calibration is not None
    assert device.calibration is outcome.calibration
    assert device.calibration.method != METHOD


def test_it_waits_while_turns_are_made_here(once: Stream) -> None:
    device, batches = DeviceSession(NAME), once.batches()
    turned = next(i for i, batch in enumerate(batches) if feed(device, [batch]) is not None and device.learnt.turned)
    assert not device.offered(own(once), 5).calibrations
    outcome = feed(device, batches[turned + 1 :])
    assert device.calibration is outcome.calibration
    assert device.calibration is not None
    assert device.calibration.method != METHOD


def test_a_newer_one_replaces_an_older_one_and_the_same_one_does_nothing(resting: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, resting.batches()[:200])
    device.offered(own(resting), 5)
    old = device.calibration
    assert not device.offered(own(resting), 6).calibrations
    newer = replace(own(resting, sequence=99), scale=(1.01, 0.99, 1.0))
    assert [c.verdict for c in device.offered(newer, 7).calibrations] == [Verdict.ACCEPTED]
    assert device.calibration is not old
    assert device.applied.model.matrix.diagonal().tolist() == [1.01, 0.99, 1.0]


def test_a_restarted_estimator_does_not_take_it_twice(resting: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, resting.batches()[:200])
    device.offered(own(resting), 5)
    restarted = DeviceSession(NAME)
    feed(restarted, resting.batches()[200:], PriorKnowledge(device.calibration, device.checkpoint()))
    assert not restarted.offered(own(resting), 6).calibrations
    assert restarted.calibration is device.calibration


def test_one_of_another_boot_is_refused_and_counted_once(resting: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, resting.batches()[:200])
    refused = [device.offered(own(resting, boot=2), 5) for _ in range(3)]
    assert [codes(c.reason) for o in refused for c in o.calibrations] == [["own_of_another_boot"]]
    assert device.calibration is None
    assert device.status(0).events[OWN_REFUSED] == 1
