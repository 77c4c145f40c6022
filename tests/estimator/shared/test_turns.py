"""Turns and calibrations while devices move: none is lost, or it is said that it is."""

from unittest.mock import Mock

import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import Quality, State
from estimator.database import Unavailable
from estimator.guide.reasons import Words, said
from tests.estimator.shared.conftest import FIRST, SECOND, Both
from tests.estimator.stream import NAME, calibration


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
    assert said(status.reason)[-1] == Words("moved", {"axes": axes})


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
