import pytest

from bridge.wire.messages import State
from estimator.lifecycle import TABLE, Event, Life

CALIBRATING = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)


def at(state: State) -> Life:
    life = Life()
    life.state = state
    return life


@pytest.mark.parametrize("state", list(State))
@pytest.mark.parametrize("event", list(Event))
def test_the_table_is_the_law_and_what_it_does_not_name_changes_nothing(state: State, event: Event) -> None:
    life = at(state)
    assert life.on(event) is ((state, event) in TABLE)
    assert life.state is TABLE.get((state, event), state)


def test_the_way_of_a_device() -> None:
    life = Life()
    path = [Event.BOOTED, Event.WARM, Event.RESTED, Event.TURNED, Event.TURNED, Event.NOT_CALIBRATED, Event.TURNED]
    assert all(life.on(event) for event in [*path, Event.CALIBRATED])
    assert life.state is State.TRACKING


@pytest.mark.parametrize("state", list(State))
def test_a_boot_starts_over_from_anywhere(state: State) -> None:
    life = at(state)
    assert life.on(Event.BOOTED)
    assert life.state is State.WARMING


@pytest.mark.parametrize("state", [s for s in State if s not in (State.TRACKING, State.DEGRADED)])
def test_tracking_is_reached_by_calibration_only(state: State) -> None:
    """Or by what stands for one: a calibration restored, or kept when a new one is cancelled."""
    ways = {event for event in Event if TABLE.get((state, event)) is State.TRACKING}
    assert ways <= {Event.CALIBRATED, Event.RESTORED, Event.CANCEL_TO_TRACKING}
    if state in (State.UNKNOWN, State.LOST):
        assert ways == set()


@pytest.mark.parametrize("state", [s for s in State if s not in (State.UNKNOWN, State.LOST)])
def test_a_lost_device_goes_on_where_it_was(state: State) -> None:
    life = at(state)
    assert not life.heard()
    assert life.on(Event.SILENT)
    assert life.state is State.LOST
    assert not life.on(Event.SILENT)
    assert not life.on(Event.CALIBRATED)
    assert life.heard()
    assert life.state is state
    assert not life.heard()


@pytest.mark.parametrize("state", CALIBRATING)
def test_cancelling_leads_where_it_came_from(state: State) -> None:
    assert TABLE[state, Event.CANCEL_TO_TRACKING] is State.TRACKING
    assert TABLE[state, Event.CANCEL_TO_START] is State.AWAITING_STILL
