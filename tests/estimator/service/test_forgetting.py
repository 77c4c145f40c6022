"""Devices that end, and devices that a person wants forgotten: nobody is needed, and nothing is left of them but the audit."""

import time
from dataclasses import replace

import pytest

from bridge.reasons.codes import Code, Sentences
from bridge.sim.motion import Still
from bridge.wire import keys
from bridge.wire.messages import Alert, State
from estimator.device.attention import needs_person
from estimator.service import history
from estimator.service.device_roster import ENDED_S
from estimator.service.periodic_checks import EVENT
from estimator.web.ward_state import Known
from tests.estimator.memory_ward import SILENCE_S, WARD, Ward
from tests.estimator.stream import NAME, Stream, calibration, info
from tests.memory_bus import MemoryBus
from tests.sentences import codes

OVER = (Code.RECORDING_OVER(place="walk.npz"),)


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1, after=[Still(1.0)])


def age(ward: Ward, seconds: float) -> None:
    """So many seconds pass in silence."""
    ward.service._devices[NAME].heard -= seconds + 1.0
    ward.service._every_second(time.monotonic())
    ward.service.work()


@pytest.mark.parametrize("reason", [OVER, (Code.DEVICE_REMOVED(bridge="bridge"),)], ids=["played", "removed"])
def test_a_device_that_ended_needs_nobody_and_leaves_after_a_while(ward: Ward, once: Stream, reason: Sentences) -> None:
    ward.send(once.batches(), info(1))
    known = Known(WARD)
    known.connected = True
    known.take_status(ward.latest(), 0.0)
    ward.send([], replace(info(1), trouble=reason))
    ward.service._devices[NAME].heard -= SILENCE_S
    ended = ward.latest()
    assert (ended.state, ended.reason) == (State.LOST, reason)
    assert not needs_person(ended, None)
    known.take_status(ended, 1.0)
    (row,) = known.rows(1.0)
    assert (row.state, row.needs_person) == ("ended", False)
    age(ward, ENDED_S)
    assert NAME not in ward.service._devices
    known.tidy(10.0)
    assert not known.rows(10.0)
    assert ward.store.calibrations(NAME), "what it was calibrated to is kept"
    more = once.part(0, 300)
    ward.send(replace(more, ticks=once.ticks[-1] + more.ticks).batches(first=len(once)), info(1))
    assert ward.latest().state is State.TRACKING, "it may come back"


def test_a_device_is_forgotten_when_no_bridge_lists_it_any_more(ward: Ward, once: Stream) -> None:
    token = MemoryBus(ward.broker).declare_alive(keys.build(WARD, "alive/bridge", bridge="bridge"))
    ward.send(once.batches(), info(1))
    ward.latest()
    refused = ward.command(lambda: ward.client.forget(NAME, "anna"))
    assert refused.message == (Code.STILL_LISTED(device=NAME, place="bridge"),)
    token.close()
    deadline = time.monotonic() + 30.0
    while ward.command(lambda: ward.client.forget(NAME, "anna")).message != (Code.STILL_SENDING(device=NAME),):
        ward.service._every_second(time.monotonic())
        assert time.monotonic() < deadline
    age(ward, SILENCE_S)
    ward.service._devices[NAME].stands([Alert("lost", 1, 2)], time.monotonic())
    assert ward.command(lambda: ward.client.forget(NAME, "anna")).accepted
    assert NAME not in ward.service._devices
    assert [(one.kind, end is not None) for one, end in ward.store.alerts(NAME)] == [("lost", True)]
    assert ward.store.calibrations(NAME)
    assert EVENT not in ward.service.counts.as_dict()
    unknown = ward.command(lambda: ward.client.forget("nobody", "anna"))
    assert Code.UNKNOWN_DEVICE in codes(unknown.message)


def test_an_erased_device_leaves_nothing_but_its_audit(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    age(ward, SILENCE_S)
    reply = ward.command(lambda: ward.client.forget(NAME, "anna", "sold", erase=True))
    assert (reply.accepted, reply.message) == (True, (Code.ERASED(who="anna"),))
    past = history.read(ward.store, NAME)
    assert (past.calibrations, past.boots, past.biases) == ([], [], [])
    assert [(row["verb"], row["who"], row["reason"]) for row in past.commands] == [("erase", "anna", "sold")]
    again = ward.command(lambda: ward.client.forget(NAME, "anna", erase=True))
    assert again.accepted, "it may be said twice"
    ward.send(once.batches(boot=2), info(2))
    assert ward.latest().state is State.TRACKING
    assert len(ward.store.calibrations(NAME)) == 1
