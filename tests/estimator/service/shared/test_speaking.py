"""Who speaks of a device: commands, silent devices, why they moved, and two of one id."""

import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire.messages import SampleBatch, State
from estimator.config.schema import Estimator
from estimator.service.cluster import DOUBLE
from estimator.service.commands import REPEATED
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.service.shared.conftest import FIRST, SECOND, WARD, Both
from tests.estimator.stream import NAME, calibration
from tests.memory_bus import MemoryBus
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


def test_two_of_one_id_are_told_of_each_other(both: Both, caplog: pytest.LogCaptureFixture) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
    alone = both.services[FIRST]
    double = Service(WARD, Estimator(id=FIRST), MemoryBus(both.broker), Store(":memory:"))
    for _ in range(30):
        both.pass_(0.1)
        double.step(0.0)
    for service in (alone, double):
        assert service.counts.as_dict()[DOUBLE] > 1
    errors = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(errors) == 2
    assert all(f"another estimator also has the id {FIRST}" in words for words in errors)
    assert DOUBLE not in both.services[SECOND].counts.as_dict()
