"""Turns and calibrations while devices move: none is lost, or it is said that it is."""

from dataclasses import replace
from unittest.mock import Mock

import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire.messages import Calibration, Quality, SampleBatch, State
from bridge.wire.refusal import Tally
from estimator.database import Unavailable
from estimator.service.record import Record
from estimator.service.replicas import Replicas, checkpoint_of
from tests.estimator.shared.conftest import FIRST, SECOND, Both
from tests.estimator.stream import NAME, calibration, info
from tests.estimator.test_replicas import calibrated


def test_turns_are_not_lost_when_an_estimator_comes(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[: len(batches) // 3])
    assert both.client.statuses(0.1)[NAME].axes_done
    both.start(SECOND)
    both.pass_(3.0)
    assert both.has() == [FIRST]
    both.send(batches[len(batches) // 3 :])
    both.pass_(1.2)
    assert both.has() == [SECOND]
    status = both.client.statuses(0.1)[NAME]
    assert status.state is State.TRACKING
    assert "turns lost with an estimator" not in status.events
    (made,) = both.stores[FIRST].calibrations(NAME)
    assert status.calibration == made.id


def test_turns_that_were_taken_by_another_are_said_to_be_lost(both: Both) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[: len(batches) * 2 // 3])
    assert both.has() == [SECOND]
    done = both.client.statuses(0.1)[NAME].axes_done
    assert done
    both.kill(SECOND)
    both.send(batches[len(batches) * 2 // 3 : -60])
    status = both.client.statuses(0.1)[NAME]
    assert both.has() == [FIRST]
    assert status.events["turns lost with an estimator"] == len(done)
    axes = ", ".join("xyz"[axis] for axis in done)
    assert status.reason[-1] == Code.TURNS_LOST(axes=axes)


def in_the_middle_of_turns(both: Both) -> list[SampleBatch]:
    """What a device sends, of which half came."""
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[: len(batches) // 2])
    return batches


def said_by_another(both: Both) -> Calibration:
    """That of an earlier epoch, by who did not know yet that it had lost the device."""
    late = checkpoint_of(calibrated()[0], both.now_ns)
    assert late is not None
    assert late.calibration is not None
    both.say_checkpoint(replace(late, epoch=7))
    return late.calibration


def test_a_calibration_by_who_did_not_know_yet_that_it_had_lost_the_device_counts(both: Both) -> None:
    in_the_middle_of_turns(both)
    assert both.has() == [SECOND]
    late = said_by_another(both)
    both.pass_(1.2)
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING
    assert both.client.statuses(0.1)[NAME].calibration == late.id
    assert [c.id for c in both.stores[SECOND].calibrations(NAME)] == [late.id]


def test_a_calibration_that_is_heard_of_while_the_device_is_lost_counts_once_it_is_back(both: Both) -> None:
    """Cut off from its bridge, and from who calibrated it there: both are back at the same moment."""
    batches = in_the_middle_of_turns(both)
    both.pass_(4.0)
    assert both.client.statuses(0.1)[NAME].state is State.LOST
    late = said_by_another(both)
    both.pass_(1.2)
    assert both.client.statuses(0.1)[NAME].state is State.LOST
    both.send(batches[len(batches) // 2 :][:20])
    both.pass_(1.2)
    assert both.client.statuses(0.1)[NAME].calibration == late.id


def test_a_calibration_that_is_void_since_is_not_taken_from_who_did_not_know(both: Both) -> None:
    batches, other = calibration(seed=1).batches(), replace(info(), gyro_range=4.0)
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[: len(batches) // 2], what=other)
    assert both.has() == [SECOND]
    late = checkpoint_of(calibrated()[0], both.now_ns)
    assert late is not None
    both.say_checkpoint(replace(late, epoch=7))
    both.pass_(1.2)
    assert both.client.statuses(0.1)[NAME].calibration == ""
    assert both.stores[SECOND].calibrations(NAME) == []


def test_a_recalibration_made_while_neither_heard_the_other_is_not_undone(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches)
    assert both.has() == [SECOND]
    record, device = both.services[SECOND]._record, both.services[SECOND]._devices[NAME]
    old = device.session.calibration
    assert old is not None
    new = replace(old, id="another", time_ns=both.now_ns)
    record.calibration(device, new, both.now)
    both.pass_(1.0)
    said = checkpoint_of(device, both.now_ns)
    assert said is not None
    record._replicas.note(replace(said, epoch=said.epoch + 5, calibration=old))  # who did not hear of it
    found = record.recall(device, old.boot)
    assert found is not None
    assert found.calibration is not None
    assert found.calibration.id == new.id
    for heard_first in (True, False):
        replicas = Replicas(1)
        restarted = Record(both.stores[SECOND], Tally(), lambda: both.now_ns, replicas=replicas)
        if not heard_first:
            assert restarted.recall(device, old.boot) is not None
        replicas.note(replace(said, epoch=said.epoch + 5, calibration=old))
        found = restarted.recall(device, old.boot)
        assert found is not None
        assert found.calibration is not None
        assert found.calibration.id == new.id, "a store knows it, too"
    third = replace(old, id="third")  # and what is made later counts again, by whomever
    record._replicas.note(replace(said, epoch=said.epoch + 6, calibration=third))
    found = record.recall(device, old.boot)
    assert found is not None
    assert found.calibration is not None
    assert found.calibration.id == third.id


def test_a_calibration_that_is_taken_over_while_the_disk_is_full_is_kept_later(
    both: Both, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches = calibration(seed=1, after=[Still(8.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[:-20])
    both.pass_(6.0)
    made = both.client.statuses(0.1)[NAME].calibration
    assert made
    with monkeypatch.context() as full:
        full.setattr(both.stores[FIRST], "add_calibration", Mock(side_effect=Unavailable("no room")))
        both.kill(SECOND)
        both.send(batches[-20:])
        both.pass_(2.0)
        assert both.has() == [FIRST]
        assert both.stores[FIRST].calibrations(NAME) == []
        assert both.services[FIRST]._devices[NAME].session.applied.quality is Quality.GOOD
    both.pass_(6.0)
    assert [c.id for c in both.stores[FIRST].calibrations(NAME)] == [made]
