"""What would be ours next is made ready for while there is time; and not for longer than that."""

import pytest

from bridge.bus.contract import Publisher
from bridge.wire.messages import SampleBatch
from estimator.service.ownership import owner
from estimator.service.shell import Service
from tests.estimator.shared.conftest import FIRST, LAST, SECOND, Both, Ward
from tests.estimator.stream import NAME


def _third(*, before_first: bool) -> str:
    """An estimator that SECOND comes before, and whose the device is, or FIRST's, once SECOND is gone."""
    names = (f"x{n}" for n in range(100))
    return next(
        name
        for name in names
        if owner(NAME, (FIRST, SECOND, name)) == SECOND and (owner(NAME, (FIRST, name)) == name) == before_first
    )


def _shared(both: Both, batches: list[SampleBatch], *names: str) -> Service:
    """FIRST, when SECOND has the device and the others are there."""
    for name in (FIRST, SECOND, *names):
        both.start(name)
    both.pass_(1.2)
    both.send(batches[:-LAST])
    assert both.has() == [SECOND]
    return both.services[FIRST]


def test_it_is_said_with_what_was_made_ready(ward: Ward, batches: list[SampleBatch]) -> None:
    interim = ward.first._interim
    publisher = interim._ready[NAME]
    assert ward.kill(batches[-LAST:])
    assert interim._said[NAME].publisher is publisher
    assert interim._ready == {}
    ward.go_on()
    assert ward.first._devices[NAME]._publishers["corrected"] is publisher


def test_where_nothing_could_be_said_it_is_given_up(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    interim, closed = ward.first._interim, []
    monkeypatch.setattr(interim, "_corrects", lambda *_: False)
    monkeypatch.setattr(interim._ready[NAME], "close", lambda: closed.append(NAME))
    assert ward.kill(batches[-LAST:]) == []
    assert ward.go_on()
    ward.both.pass_(1.0)
    assert (interim._ready, closed) == ({}, [NAME])
    assert ward.first._devices[NAME]._publishers["corrected"] is not None


def test_only_who_is_next_makes_ready_for_a_device(both: Both, batches: list[SampleBatch]) -> None:
    last = _third(before_first=False)
    _shared(both, batches, last)
    ready = {name: list(service._interim._ready) for name, service in both.services.items()}
    assert ready == {FIRST: [NAME], SECOND: [], last: []}


def test_who_is_next_no_more_gives_it_up(both: Both, batches: list[SampleBatch]) -> None:
    first = _shared(both, batches)
    assert list(first._interim._ready) == [NAME]
    both.start(_third(before_first=True))
    both.pass_(3.0)
    assert first._interim._ready == {}


def test_it_stays_ready_for_a_device_that_pauses(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    """zenoh never gives back all that it takes to declare something, and a router that comes back is when it is needed."""
    first, declared = _shared(both, batches), list[str]()
    publisher, declare = first._interim._ready[NAME], first._interim._declare

    def counted(device: str) -> Publisher:
        declared.append(device)
        return declare(device)

    monkeypatch.setattr(first._interim, "_declare", counted)
    both.pass_(15.0)
    assert NAME not in first._peers._standby
    both.send(batches[-LAST:])
    both.pass_(2.0)
    assert first._interim._ready == {NAME: publisher}
    assert declared == []


def test_no_more_are_ready_than_there_is_room_for(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    interim = _shared(both, batches)._interim
    monkeypatch.setattr("estimator.service.interim.MOST", 3)
    work = [done for n in range(4) for _, done in interim.ahead({NAME, f"d{n}-a", f"d{n}-b"})]
    for one in work:
        one()
    assert len(interim._ready) == 3


def test_for_names_that_nobody_has_nothing_is_made_ready(both: Both, batches: list[SampleBatch]) -> None:
    """A name costs nothing to make up."""
    peers = _shared(both, batches)._peers
    message = peers._standby._queues[NAME].held[0].message
    for n in range(50):
        peers._standby.hold(f"made-up-{n}", message, both.now)
    assert peers.next_in_line() == {NAME}


def test_what_is_ready_is_taken_back_at_the_end(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    interim, closed = _shared(both, batches)._interim, []
    monkeypatch.setattr(interim._ready[NAME], "close", lambda: closed.append(NAME))
    interim.close()
    assert (interim._ready, closed) == ({}, [NAME])


def test_a_device_of_ours_is_looked_after_while_what_was_ready_for_it_is_given_up(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    ward.kill(batches[-LAST:])
    ward.go_on()
    first, looked = ward.first, list[str]()
    first._quiet.finish()
    first._interim._ready[NAME] = first._interim._declare(NAME)
    monkeypatch.setattr(first, "_look_after", lambda device: looked.append(device.name))
    first._every_second(ward.both.now)
    first._quiet.finish()
    assert (looked, first._interim._ready) == ([NAME], {})
