"""Turns and calibrations while devices move: none is lost, or it is said that it is."""

from bridge.sim.motion import Still
from bridge.wire.messages import State
from tests.estimator.service.shared.conftest import FIRST, SECOND, Both
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
