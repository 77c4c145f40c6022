from pathlib import Path

import pytest

from bridge.wire.messages import State
from estimator.device.lifecycle import AWAY, CAUSES, TABLE, Event, Lifecycle

DOC = Path(__file__).parents[3] / "docs" / "life.md"
CANCELS = (Event.CANCEL_TO_TRACKING, Event.CANCEL_TO_START)
THERE = [s for s in State if s not in AWAY]


def at(state: State) -> Lifecycle:
    life = Lifecycle()
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
            ways.setdefault("the earlier state" if isinstance(to, type) else word(to), []).append(word(state))
    everywhere = [word(state) for state in State]
    return "; ".join(f"{'any' if came == everywhere else ', '.join(came)} → {to}" for to, came in ways.items())


def word(state: State) -> str:
    return state.name.lower().replace("_", "-")
