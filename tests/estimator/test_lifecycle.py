from pathlib import Path

import pytest

from bridge.wire.messages import State
from estimator.lifecycle import AWAY, CAUSES, TABLE, Event, Life
from tests.sentences import free

CALIBRATING = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)
DOC = Path(__file__).parents[2] / "docs" / "life.md"
CANCELS = (Event.CANCEL_TO_TRACKING, Event.CANCEL_TO_START)
THERE = [s for s in State if s not in AWAY]


def at(state: State) -> Life:
    life = Life()
    life.state = life._before = state
    return life


@pytest.mark.parametrize("state", list(State))
@pytest.mark.parametrize("event", list(Event))
def test_the_table_is_the_law_and_what_it_does_not_name_changes_nothing(state: State, event: Event) -> None:
    if state in AWAY and event in (Event.HEARD, Event.DOUBTED, Event.CHANGED, *CANCELS):
        return  # these are told by where it was: below
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


@pytest.mark.parametrize("gone", [Event.SILENT, Event.UNREACHABLE, Event.OUTDATED])
@pytest.mark.parametrize("state", THERE)
def test_a_device_that_was_away_goes_on_where_it_was(state: State, gone: Event) -> None:
    life = at(state)
    assert not life.on(Event.HEARD)
    assert life.on(gone)
    assert life.away
    assert not life.on(gone) or gone is Event.SILENT
    assert not life.on(Event.WARM)
    assert life.on(Event.HEARD)
    assert life.state is state
    assert not life.on(Event.HEARD)


@pytest.mark.parametrize("gone", [Event.SILENT, Event.UNREACHABLE])
def test_what_its_last_samples_teach_while_it_is_away_holds_when_it_is_back(gone: Event) -> None:
    life = at(State.TURNING)
    assert life.on(gone)
    assert life.on(Event.TURNED, free("the third"))
    assert life.on(Event.CALIBRATED, free("calibrated"))
    assert life.away
    assert life.on(Event.HEARD)
    assert (life.state, life.reason) == (State.TRACKING, free("calibrated"))


@pytest.mark.parametrize("state", THERE)
def test_a_router_that_is_gone_makes_it_unknown_not_lost(state: State) -> None:
    life = at(state)
    assert life.on(Event.UNREACHABLE)
    assert life.state.name == "UNKNOWN"
    assert life.on(Event.SILENT), "the router is back, the device is not"
    assert life.state.name == "LOST"
    assert not life.on(Event.UNREACHABLE), "what was lost before is still the last that is known"
    assert life.on(Event.HEARD)
    assert life.state is state


@pytest.mark.parametrize("state", THERE)
def test_one_that_speaks_with_an_old_clock_is_not_lost(state: State) -> None:
    life = at(state)
    assert life.on(Event.SILENT)
    assert life.on(Event.OUTDATED)
    assert life.state.name == "UNKNOWN"
    assert life.on(Event.SILENT)
    assert life.on(Event.HEARD)
    assert life.state is state


@pytest.mark.parametrize("away", AWAY)
@pytest.mark.parametrize("event", [*CANCELS, Event.CHANGED, Event.DOUBTED])
@pytest.mark.parametrize("state", THERE)
def test_what_happens_while_it_is_away_is_so_when_it_is_heard_again(state: State, event: Event, away: State) -> None:
    life = at(state)
    life.state = away
    assert life.on(event) is ((state, event) in TABLE)
    assert life.state is away
    assert life.on(Event.HEARD)
    assert life.state is TABLE.get((state, event), state)


def test_a_device_never_heard_has_nowhere_to_go_back_to() -> None:
    life = Life()
    assert not life.on(Event.HEARD)
    assert life.state is State.UNKNOWN


def test_the_table_for_people_is_the_table() -> None:
    """docs/life.md: a row an event, with its cause, and from where to where it leads."""
    rows = [line.split("|") for line in DOC.read_text().splitlines() if line.startswith("| `")]
    told = {event.strip(" `"): (cause.strip(), leads.strip()) for _, event, cause, leads, _ in rows}
    assert told == {event.value: (CAUSES[event], leads(event)) for event in Event}


def leads(event: Event) -> str:
    """`from, from → to; from → to`, states in the order of their numbers."""
    ways: dict[str, list[str]] = {}
    for state in State:
        to = TABLE.get((state, event))
        if to is not None:
            ways.setdefault("where it was" if isinstance(to, type) else word(to), []).append(word(state))
    everywhere = [word(state) for state in State]
    return "; ".join(f"{'any' if came == everywhere else ', '.join(came)} → {to}" for to, came in ways.items())


def word(state: State) -> str:
    return state.name.lower().replace("_", "-")


@pytest.mark.parametrize("state", CALIBRATING)
def test_cancelling_leads_where_it_came_from(state: State) -> None:
    assert TABLE[state, Event.CANCEL_TO_TRACKING] is State.TRACKING
    assert TABLE[state, Event.CANCEL_TO_START] is State.AWAITING_STILL
