"""Every view agrees on which devices need a person, also when a calibration was begun and left."""

from dataclasses import replace

import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import SessionPlan, TurnPlan
from bridge.wire.messages import DeviceInfo, State, Status
from estimator.device.attention import needs_person
from estimator.device.session import DeviceSession
from estimator.language.texts import texts
from estimator.overview.summary import summarise
from estimator.service.health import DeviceHealth, Note, ServiceHealth
from estimator.web import reports
from estimator.web.api import answers
from estimator.web.tiles import ward_page
from estimator.web.ward_state import Known
from tests.estimator.guide.scripted import batches
from tests.estimator.stream import NAME, calibration, feed
from tests.web.talk import about, said

EN = texts("en")
BAD = (Code.SAMPLES_BAD(percent="3", label="clipped"),)


def told(status: Status, info: DeviceInfo) -> dict[str, bool]:
    """Whether the device needs a person, by view."""
    known, name = Known("w"), status.device
    known.connected = True
    known.take_info(info)
    known.take_status(status, 10.0)
    health = ServiceHealth()
    health.note(Note(0.0, True, "", {name: DeviceHealth(status, 1.0, 0.0, 0, needs_person(status, info))}))
    metric = next(family for family in health.families() if family.name == "needs_person")
    (row,), (tile,) = known.rows(10.0), ward_page(known, 10.0, 1, EN).tiles
    return {
        "status": bool(summarise("w", {name: status}, {name: info}, ["b"], ["e"]).needs),
        "watch": row.needs_person,
        "page": tile.needs,
        "colour": tile.tone in ("ask", "bad"),
        "api": answers.device(row, known.stories[name]).needs_person,
        "report": bool(reports.summary(known, 10.0, EN)["needs"]),
        "metrics": bool(metric.values[(name,)]),
    }


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize(
    ("changes", "complains"),
    [
        ({}, False),
        ({"battery_percent": 9.0}, True),
        ({"battery_percent": 9.0, "charging": True}, False),
        ({"notices": BAD}, True),
    ],
)
def test_all_views_agree(state: State, changes: dict[str, object], complains: bool) -> None:
    needs = complains or state not in (State.TRACKING, State.WARMING)
    assert set(told(said("a", state), replace(about("a"), **changes)).values()) == {needs}  # type: ignore[arg-type]


@pytest.mark.parametrize("minutes", [1.0, 12.0])
def test_a_calibration_that_was_left_needs_a_person(minutes: float) -> None:
    """Two turns, and never a third; after ten minutes the turns are too old."""
    plan = SessionPlan(3.4, (TurnPlan(2), TurnPlan(0)), (4.0, 5.0))
    device = DeviceSession(NAME)
    feed(device, batches(calibration(seed=1, plan=plan, after=[Still(60.0 * minutes)])))
    status = device.status(1)
    assert status.state is State.TURNING
    assert (Code.TURN_TOO_OLD in {one.code for one in status.reason}) == (minutes > 10)
    assert set(told(status, about(NAME)).values()) == {True}
