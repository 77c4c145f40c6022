"""Who speaks of a device: commands, silent devices, why they moved, and two of one id."""

import pytest

from bridge.bus.memory_bus import MemoryBus
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch, State
from estimator.config import Estimator
from estimator.service.cluster import DOUBLE
from estimator.service.orders import REPEATED
from estimator.service.shell import Service
from estimator.service.store import Store
from tests.estimator.shared.conftest import FIRST, SECOND, WARD, Both
from tests.estimator.stream import NAME, calibration
from tests.sentences import codes


def silent(both: Both) -> list[SampleBatch]:
    """SECOND has calibrated the device, and hears nothing of it any more; the last 20 of these batches are still to come."""
    batches = calibration(seed=1, after=[Still(8.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[:-20])
    both.pass_(30.0)
    return batches


def test_of_a_silent_device_whoever_takes_over_goes_on_to_speak(both: Both) -> None:
    batches = silent(both)
    before = both.client.statuses(0.1)[NAME]
    assert before.state is State.LOST
    both.kill(SECOND)
    both.pass_(3.0)
    after = both.client.statuses(0.1)[NAME]
    assert (after.state, after.boot, after.calibration) == (State.LOST, before.boot, before.calibration)
    assert after.epoch > before.epoch
    assert Code.NO_SAMPLES in codes(after.reason)
    # It is heard again: by who speaks of it, and as it was.
    both.send(batches[-20:])
    both.pass_(1.2)  # all say their status once a second
    assert both.has() == [FIRST]
    heard = both.client.statuses(0.1)[NAME]
    assert (heard.state, heard.calibration) == (State.TRACKING, before.calibration)


def test_what_moved_is_not_put_down_to_who_went_long_before(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-60])
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[-60:])
    assert both.has() == [SECOND]
    reasons = [move.reason for move in both.services[SECOND]._cluster._moves]
    assert reasons == [(Code.SHARED_ANEW(),)], "another had it, so it was not heard for the first time"
    third = MemoryBus(both.broker)
    token = third.declare_alive(keys.build(WARD, "alive/estimator", estimator="e9"))
    both.told()
    both.pass_(0.5)
    token.close()
    both.told()
    both.pass_(5.0)
    for service in both.services.values():
        assert service._cluster._why == ()
    third.close()


def test_a_command_that_is_sent_again_after_its_device_has_moved_does_nothing(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-120])
    asked, cancelled = both.command("recalibrate", "r1"), both.command("cancel", "r2")
    assert (asked.accepted, cancelled.accepted) == (True, True)

    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[-120:-60])
    assert both.has() == [SECOND]
    assert (both.command("recalibrate", "r1"), both.command("cancel", "r2")) == (asked, cancelled)
    assert both.services[SECOND].counts.as_dict()[REPEATED] == 2
    assert both.command("cancel", "r1").accepted is False, "another verb is another command"

    both.kill(SECOND)
    both.send(batches[-60:])
    both.pass_(1.5)
    assert both.has() == [FIRST]
    assert both.command("recalibrate", "r1") == asked
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING


def test_an_answer_is_known_to_the_others_before_it_is_given(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.send(batches[:-60])
    assert both.has() == [SECOND]
    asked = both.command("recalibrate", "r1")
    both.kill(SECOND)
    both.send(batches[-60:])
    both.pass_(2.0)
    assert both.has() == [FIRST]
    assert both.command("cancel", "r2").accepted
    assert both.command("recalibrate", "r1") == asked
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING


def test_two_of_one_id_are_told_of_each_other(both: Both, caplog: pytest.LogCaptureFixture) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
    alone = both.services[FIRST]
    double = Service(WARD, Estimator(id=FIRST), MemoryBus(both.broker), MemoryBus(both.broker), Store(":memory:"))
    for _ in range(30):
        both.pass_(0.1)
        double.step(0.0)
    for service in (alone, double):
        assert service.counts.as_dict()[DOUBLE] > 1
    errors = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(errors) == 2
    assert all(f"another estimator says to be {FIRST}" in words for words in errors)
    assert DOUBLE not in both.services[SECOND].counts.as_dict()


def test_what_is_known_of_a_silent_device_is_told_to_who_joins_and_is_to_have_it(both: Both) -> None:
    batches = silent(both)
    before = both.client.statuses(0.1)[NAME]
    both.kill(SECOND)
    both.pass_(3.0)
    both.start(SECOND)  # a new machine: its store is empty
    both.pass_(5.0)
    both.send(batches[-20:])
    both.pass_(1.2)
    assert both.has() == [SECOND]
    after = both.client.statuses(0.1)[NAME]
    assert (after.state, after.calibration) == (State.TRACKING, before.calibration)


def test_a_device_that_was_silent_may_come_back_at_another_bridge(both: Both) -> None:
    batches = silent(both)
    both.kill(SECOND)
    both.pass_(3.0)
    other = MemoryBus(both.broker)
    raw = other.publisher(keys.build(WARD, "raw", bridge="other", device=NAME), cache=1)
    for batch in batches[-20:]:
        raw.put(codec.encode_samples(batch))
    both.pass_(1.2)
    session = both.services[FIRST]._devices[NAME].session
    assert not [label for label in session.sequence.events.as_dict() if label.startswith("also from")]
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING
    other.close()
