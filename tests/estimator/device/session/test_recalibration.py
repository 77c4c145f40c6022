"""A calibration that is asked for again, and cancelled."""

import numpy as np
import pytest

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Quality, State
from estimator.device.boot_calibration import CANCELLED_S
from estimator.device.session import DeviceSession
from tests.estimator.device.session.lives import again, calibrated, shaken, state
from tests.estimator.stream import NAME, Stream, feed


def test_the_old_calibration_stays_in_use_until_the_new_one(once: Stream) -> None:
    device = calibrated(once)
    old = device.calibration
    assert old is not None
    assert device.recalibrate("nurse", "new strap") is None
    assert device.life.reason[:2] == (Code.RECALIBRATION_ASKED(who="nurse"), Code.REQUEST_REASON(words="new strap"))
    more = again(once)
    outcome = feed(device, more.batches(first=len(once)))
    assert outcome.calibration is not None
    assert outcome.calibration.who == "nurse"
    assert outcome.calibration.id != old.id
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    used = [b.calibration for b in outcome.corrected]
    assert used == [old.id] * used.count(old.id) + [outcome.calibration.id] * used.count(outcome.calibration.id)
    assert used[-1] == outcome.calibration.id
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), once.truth.k, atol=3e-4)


@pytest.mark.parametrize("after_s", [0.0, 31.0, 34.0, 40.0, 44.0])
def test_cancelled_at_any_stage_the_old_one_stays(once: Stream, after_s: float) -> None:
    device = calibrated(once)
    old = device.calibration
    device.recalibrate("nurse", "")
    more = again(once)
    batches = more.batches(first=len(once))
    upto = int(after_s * 104 / 10)
    feed(device, batches[:upto])
    assert state(device) is not State.TRACKING
    assert device.cancel("nurse") is None
    assert device.cancel("nurse") is not None, "once is enough"
    assert state(device) is State.TRACKING
    outcome = feed(device, batches[upto:])
    assert outcome.calibration is None, "turns after that are movement"
    assert device.calibration is old
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)


@pytest.mark.parametrize("doubt", [(), (Code.NO_REST_FOR(minutes="31"),)], ids=["sure", "doubted"])
def test_that_it_was_cancelled_is_said_for_a_minute(once: Stream, doubt: Sentences) -> None:
    device = calibrated(once)
    device.tracker.doubt.why = doubt
    device.recalibrate("nurse", "")
    device.cancel("nurse")
    cancelled = (Code.CALIBRATION_CANCELLED(who="nurse"), Code.OLD_CALIBRATION_STAYS())
    batches = again(once, rest_s=70.0).batches(first=len(once)) if not doubt else shaken(once).batches(first=len(once))
    at = [batch.device_time[-1] - once.time[-1] for batch in batches]
    told = [(feed(device, [batch]).changed, device.life.reason) for batch in batches]
    back = next(n for n, (_, reason) in enumerate(told) if reason != cancelled)
    assert at[back] == pytest.approx(CANCELLED_S, abs=2.0)  # counted in what was learnt, which is up to two seconds old
    assert told[back] == (True, doubt or (Code.CALIBRATION_GOES_ON(),))
    assert state(device) is (State.DEGRADED if doubt else State.TRACKING)


def test_cancelled_before_there_was_any_it_starts_over(once: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, once.part(0, once.at(17.0)).batches())
    assert state(device) is State.TURNING
    assert device.cancel("nurse") is None
    assert (state(device), device.status(1).axes_done) == (State.AWAITING_STILL, ())
