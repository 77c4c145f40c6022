"""What is published of devices before they have sessions, where more is taken over in every round, or again at buffer."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from bridge.bus.memory_bus import MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, SampleBatch
from estimator.client import Miss
from estimator.client.reorder_buffer import ReorderBuffer
from estimator.service.interim import HUNG_NS, RECENT_NS, Taken
from tests.estimator.shared.conftest import LAST, SECOND, WARD, Ward
from tests.estimator.stream import NAME

#: batches that whoever had the device had not done
UNDONE = 4


def kill_leaving(ward: Ward, batches: list[SampleBatch]) -> None:
    ward.both.kill(SECOND)
    for batch in batches:
        ward.both._raw.put(codec.encode_samples(batch))


def rounds_with_strangers(ward: Ward, batch: SampleBatch, n: int) -> Iterator[tuple[float, list[CorrectedBatch]]]:
    """So many rounds of 20 ms, in each of which a device comes that nobody has heard of: when, and what is said of NAME."""
    both, bus = ward.both, MemoryBus(ward.both.broker)
    for number in range(n):
        name = f"new-{number}"
        publisher = bus.publisher(keys.build(WARD, "raw", bridge="x", device=name))
        publisher.put(codec.encode_samples(replace(batch, device=name)))
        both.now, both.now_ns = both.now + 0.02, both.now_ns + 20_000_000
        ward.first.step(0.0)
        yield both.now, [said for said in ward.said() if said.device == NAME]


def test_one_new_name_in_each_round_keeps_nobody_from_a_session(ward: Ward, batches: list[SampleBatch]) -> None:
    kill_leaving(ward, batches[-LAST:])
    for _ in rounds_with_strangers(ward, batches[-1], 20):
        pass
    assert NAME in ward.first._devices
    assert not ward.first._interim.behind


def test_what_its_owner_had_not_done_is_said_before_subscribers_give_it_up(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    last, buffer = batches[-UNDONE:], ReorderBuffer()
    assert RECENT_NS < last[-1].receive_time_ns - last[0].receive_time_ns < HUNG_NS
    ward.both.send(batches[-LAST:-UNDONE])
    for batch in (*ward.before, *ward.said()):
        buffer.feed(batch, ward.both.now)
    buffer.ready.clear()
    kill_leaving(ward, last)
    monkeypatch.setattr(ward.first._peers, "turn", list)
    for now, said in rounds_with_strangers(ward, batches[-1], 10):
        for batch in said:
            buffer.feed(batch, now)
        buffer.overdue(now)
    monkeypatch.undo()
    ward.both.pass_(1.0)
    assert [one for one in buffer.ready if isinstance(one, Miss)] == []
    given = [one for one in buffer.ready if isinstance(one, CorrectedBatch)]
    assert sum(map(len, given)) == sum(map(len, last))


def test_one_of_which_nothing_could_be_said_leaves_nothing_to_be_said_from_anothers_place(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lost, and taken again before the rest of it was said, that rest stood where another device is by then."""
    interim, replicas, other = ward.first._interim, ward.first._peers.replicas, "other"
    say = interim.say

    def fails(*_: object) -> None:
        raise ZeroDivisionError

    def renamed(one: Taken) -> Taken:
        messages = [
            message._replace(
                key=message.key.replace(NAME, other),
                payload=codec.encode_samples(replace(codec.decode_samples(*message), device=other)),
            )
            for message in one.messages
        ]
        return Taken(other, one.epoch, messages)

    def taken_twice(taken: list[Taken]) -> None:
        known = replicas.of(NAME)
        assert known is not None
        replicas.note(replace(known, device=other))
        with monkeypatch.context() as failing:
            failing.setattr("estimator.service.published.Encoder.encode", fails)
            say(taken)
        say([renamed(*taken)])
        interim.drop(NAME)
        say(taken)

    heard = MemoryBus(ward.both.broker).subscribe(keys.pattern(WARD, "corrected"))
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(interim, "say", taken_twice)
        meanwhile.setattr(ward.first._peers, "turn", list)
        kill_leaving(ward, batches[-UNDONE:])
        ward.both.pass_(0.2)
    said = [codec.decode_corrected(*message).device for message in heard.drain(10_000, 0.0)]
    assert said.count(NAME) >= UNDONE
    assert said.count(other) >= UNDONE
    for publisher in interim.drop(other):
        publisher.close()
    ward.both.pass_(1.0)
