"""What would be ours next is made ready for while there is time; and not for longer than that."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.contract import Publisher
from bridge.wire.messages import Checkpoint, SampleBatch
from estimator.correction import Correction
from estimator.remembered import correction
from estimator.service import interim
from estimator.service.interim import FAILED
from estimator.service.ownership import owner
from estimator.service.ready import AHEAD_S
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
    ours = ward.first._interim
    publisher = ours.ready.publishers[NAME]
    assert ward.kill(batches[-LAST:])
    assert ours._said[NAME].publisher is publisher
    assert ours.ready.publishers == {}
    ward.go_on()
    assert ward.first._devices[NAME]._publishers["corrected"] is publisher


def test_where_nothing_could_be_said_it_is_given_up(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, closed = ward.first._interim, []
    monkeypatch.setattr(ours, "_corrects", lambda *_: None)
    monkeypatch.setattr(ours.ready.publishers[NAME], "close", lambda: closed.append(NAME))
    assert ward.kill(batches[-LAST:]) == []
    assert ward.go_on()
    ward.both.pass_(1.0)
    assert (ours.ready.publishers, closed) == ({}, [NAME])
    assert ward.first._devices[NAME]._publishers["corrected"] is not None


def test_only_who_is_next_makes_ready_for_a_device(both: Both, batches: list[SampleBatch]) -> None:
    last = _third(before_first=False)
    _shared(both, batches, last)
    ready = {name: list(service._interim.ready.publishers) for name, service in both.services.items()}
    assert ready == {FIRST: [NAME], SECOND: [], last: []}


def test_who_is_next_no_more_gives_it_up(both: Both, batches: list[SampleBatch]) -> None:
    first = _shared(both, batches)
    assert list(first._interim.ready.publishers) == [NAME]
    both.start(_third(before_first=True))
    both.pass_(3.0)
    assert first._interim.ready.publishers == {}


def test_it_stays_ready_for_a_device_that_pauses(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    """zenoh never gives back all that it takes to declare something, and a router that comes back is when it is needed."""
    first, declared = _shared(both, batches), list[str]()
    ready = first._interim.ready
    publisher, declare = ready.publishers[NAME], ready._declare

    def counted(device: str) -> Publisher:
        declared.append(device)
        return declare(device)

    monkeypatch.setattr(ready, "_declare", counted)
    both.pass_(15.0)
    assert NAME not in first._peers._standby
    both.send(batches[-LAST:])
    both.pass_(2.0)
    assert first._interim.ready.publishers == {NAME: publisher}
    assert declared == []


def test_what_is_to_be_made_ready_for_a_device_that_is_ours_by_then_is_not(
    both: Both, batches: list[SampleBatch]
) -> None:
    ready = _shared(both, batches)._interim.ready
    ready._drop(NAME)
    ((_, prepare),) = ready.ahead({NAME})
    both.kill(SECOND)
    both.pass_(1.0)
    assert both.has() == [FIRST]
    prepare()
    assert ready.publishers == {}


def test_no_more_are_ready_than_there_is_room_for(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = _shared(both, batches)._interim
    monkeypatch.setattr("estimator.service.ready.MOST", 3)
    work = [done for n in range(4) for _, done in ours.ready.ahead({NAME, f"d{n}-a", f"d{n}-b"})]
    for one in work:
        one()
    assert len(ours.ready.publishers) == 3


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
    ours, closed = _shared(both, batches)._interim, []
    monkeypatch.setattr(ours.ready.publishers[NAME], "close", lambda: closed.append(NAME))
    ours.close()
    assert (ours.ready.publishers, closed) == ({}, [NAME])


def test_a_device_of_ours_is_looked_after_while_what_was_ready_for_it_is_given_up(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    ward.kill(batches[-LAST:])
    ward.go_on()
    first, looked = ward.first, list[str]()
    first._quiet.finish()
    first._interim.ready.publishers[NAME] = first._interim._declare(NAME)
    monkeypatch.setattr(first, "_look_after", lambda device: looked.append(device.name))
    first._every_second(ward.both.now)
    first._quiet.finish()
    assert (looked, first._interim.ready.publishers) == ([NAME], {})


def test_what_corrects_it_was_made_ready_too(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    ward.both.pass_(6.0)  # a checkpoint after the last sample
    monkeypatch.setattr(interim, "correction", lambda *_: pytest.fail("there is no time for that"))
    said = ward.kill(batches[-LAST:])
    first = ward.first
    anew = first._peers.replicas.recall(NAME, said[0].boot, first._now_ns())
    exact = correction(anew, float(batches[-1].device_time[-1]), first._treatment.of(NAME))
    assert exact is not None
    assert sum(len(batch) for batch in said) == sum(len(batch) for batch in batches[-LAST:])
    assert {batch.epoch for batch in said} == {first._peers.cluster.held[NAME]}
    for batch in said:
        assert batch.quality is exact.quality
        assert batch.calibration == exact.calibration
        assert np.array_equal(batch.bias, exact.told.bias)
        assert (batch.bias_std >= exact.told.bias_std).all()
        assert (batch.bias_std < 1.5 * exact.told.bias_std).all()
    ward.go_on()


def test_what_corrects_it_is_made_ready_anew_after_each_checkpoint_and_not_oftener(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, made = _shared(both, batches), list[Checkpoint]()
    ready, applies = first._interim.ready, first._interim.ready._applies

    def counted(known: Checkpoint, at_s: float) -> Correction | None:
        made.append(known)
        return applies(known, at_s)

    monkeypatch.setattr(ready, "_applies", counted)
    heard = [first._peers.replicas.of(NAME)]
    for _ in range(100):
        both.pass_(0.2)
        if first._peers.replicas.of(NAME) is not heard[-1]:
            heard.append(first._peers.replicas.of(NAME))
    assert 4 <= len(heard) <= 7
    assert made == heard[-len(made) :]
    assert len(made) >= len(heard) - 2


@pytest.mark.parametrize("after_s", [-0.1, AHEAD_S + 0.1])
def test_what_was_made_ready_holds_for_its_time_only(both: Both, batches: list[SampleBatch], after_s: float) -> None:
    first = _shared(both, batches)
    both.pass_(6.0)
    ready, known = first._interim.ready, first._peers.replicas.of(NAME)
    assert known is not None
    during = ready.correction(known, known.device_time_s + 0.1)
    assert during is ready.correction(known, known.device_time_s + AHEAD_S - 0.1)
    other = ready.correction(known, known.device_time_s + after_s)
    assert other is not None
    assert during is not None
    assert other.bias_std.tolist() != during.bias_std.tolist()
    again = replace(known, time_ns=known.time_ns + 1)
    assert ready.correction(again, known.device_time_s + 0.1) is not during, "of another checkpoint"


def test_a_device_that_nothing_can_be_made_ready_for_costs_nobody_anything(
    both: Both, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = _shared(both, batches)

    def broken(*_: object) -> Correction | None:
        raise ValueError("a fault")

    monkeypatch.setattr(first._interim.ready, "_applies", broken)
    both.pass_(12.0)
    both.send(batches[-LAST:])
    both.kill(SECOND)
    both.pass_(2.0)
    assert both.has() == [FIRST]
    assert first.counts.as_dict()[FAILED] == 1
