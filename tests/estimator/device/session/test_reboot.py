"""What a reboot ends, and what is known again after it or after a restart."""

from dataclasses import replace

import numpy as np

from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Quality, State
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import DeviceSession
from tests.estimator.device.session.lives import calibrated, state
from tests.estimator.stream import NAME, Stream, calibration, feed, rates


def test_a_reboot_in_the_middle_of_a_turn_forgets_the_turns(once: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, once.part(0, once.at(17.0)).batches(boot=1))
    assert device.status(1).axes_done != ()
    feed(device, calibration(TurnPlan(2), seed=9).batches(boot=2))
    assert device.status(1).axes_done == (2,)
    assert state(device) is State.TURNING


def test_an_earlier_boots_scale_is_a_prior_until_the_first_calibration(once: Stream) -> None:
    old = calibrated(once).calibration
    assert old is not None
    device = DeviceSession(NAME)
    outcome = feed(device, calibration(seed=1, before_s=2.0).batches(boot=2), PriorKnowledge(old, None))
    first = outcome.corrected[0]
    assert first.quality is Quality.PRIOR
    assert first.calibration == old.id
    assert (first.bias_std > np.radians(1.0)).all(), "a turn-on bias is not repeated"
    resting = [b for b in outcome.corrected if b.quality is Quality.BIAS_ONLY]
    assert (resting[0].scale_std >= 0.02).all()
    assert (resting[0].bias_std < np.radians(0.25)).all(), "a second says something"
    assert (resting[-1].bias_std < np.radians(0.07)).all(), "some rests say more"
    last = outcome.corrected[-1]
    assert last.quality is Quality.GOOD
    assert last.calibration != old.id


def test_the_same_boot_is_restored_at_once(once: Stream) -> None:
    half = once.at(32.0)
    device = DeviceSession(NAME)
    feed(device, once.part(0, half).batches())
    assert device.calibration is not None
    remembered = PriorKnowledge(device.calibration, device.checkpoint())
    rest = once.part(half, len(once)).batches(first=half)
    resumed = DeviceSession(NAME)
    outcome = feed(resumed, rest, remembered)
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    assert resumed.life.state is State.TRACKING
    expected = feed(device, rest)
    np.testing.assert_allclose(rates(outcome.corrected), rates(expected.corrected), atol=np.radians(0.01))


def test_a_clock_that_goes_back_goes_on(once: Stream) -> None:
    """A bridge that was restarted 71 minutes after the device counts the 32 bits of its ticks from anew."""
    wrapped = 2**32
    late = replace(once, ticks=once.ticks + wrapped)
    half = late.at(late.time[0] + 40.0)
    device = DeviceSession(NAME)
    feed(device, late.part(0, half).batches())
    assert state(device) is State.TRACKING
    after = late.part(half, len(late))
    device.learnt.receipts.clear()
    outcome = feed(device, replace(after, ticks=after.ticks - wrapped).batches(first=half))
    assert device.learnt.receipts, "rests are recognised as before"
    assert device.status(1).events["device clock went back"] == 1
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    np.testing.assert_array_equal(outcome.corrected[0].ticks, after.ticks[: len(outcome.corrected[0])] - wrapped)
