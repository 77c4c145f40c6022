"""Who publishes tells which message was its last: soon after it, but not after each where the next one tells as much."""

import time
from collections.abc import Iterator
from itertools import pairwise

import pytest
import zenoh

from bridge.bus.zenoh_bus import _HEARTBEAT_S, _REPEAT_S, _REPEATED_S, _STREAM, ZenohBus, _Publisher
from bridge.bus.zenoh_subscription import Repaired
from tests.bridge.bus.worlds import ZenohWorld, eventually


@pytest.fixture
def bus() -> Iterator[ZenohBus]:
    world = ZenohWorld()
    with world.bus() as made:
        assert isinstance(made, ZenohBus)
        yield made
    world.stop()


@pytest.mark.parametrize(("cache", "meanwhile"), [(_STREAM, False), (_STREAM - 1, True)])
def test_a_stream_tells_its_last_number_when_it_pauses(bus: ZenohBus, cache: int, meanwhile: bool) -> None:
    heard = bus.subscribe("t/one/@adv/pub/**")
    one = bus.publisher("t/one", cache=cache)
    for _ in range(60):
        one.put(b"")
        time.sleep(0.02)
    assert bool(heard.drain(100, 0.05)) is meanwhile
    eventually(lambda: (59).to_bytes(4, "little") in [message.payload for message in heard.drain(100, 0.1)])


def test_the_last_message_of_a_stream_is_fetched_again_though_nothing_follows(
    bus: ZenohBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, found = bus.publisher("t/one", cache=_STREAM), bus.subscribe("t/one", history=True)
    assert isinstance(found, Repaired)
    one.put(b"0")
    assert [message.payload for message in found.drain(9, 2.0)] == [b"0"]
    lost = list[object]()
    monkeypatch.setattr(found, "_take", lost.extend)
    one.put(b"1")
    eventually(lambda: bool(lost))
    monkeypatch.undo()
    began = time.monotonic()
    assert [message.payload for message in found.drain(9, 2.0)] == [b"1"]
    assert time.monotonic() - began < _REPEAT_S, "not only with what is repeated"


@pytest.mark.parametrize("key", ["t/one/@adv/pub/**", "t/*/@adv/pub/**", "t/one/@adv/pub/*/1/_", "t/one/@adv/pub/1"])
def test_who_says_it_of_many_at_once_or_of_nobody_keeps_no_loss_from_being_fetched(
    bus: ZenohBus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, key: str
) -> None:
    one, found = bus.publisher("t/one", cache=_STREAM), bus.subscribe("t/*", history=True)
    assert isinstance(found, Repaired)
    one.put(b"0")
    assert [message.payload for message in found.drain(9, 2.0)] == [b"0"]
    bus._session.put(key, bytes(4))
    time.sleep(0.1)
    lost = list[object]()
    monkeypatch.setattr(found, "_take", lost.extend)
    one.put(b"1")
    eventually(lambda: bool(lost))
    monkeypatch.undo()
    assert [message.payload for message in found.drain(9, 2.0)] == [b"1"]
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_what_is_said_under_a_pattern_is_handed_on_and_ends_nothing(bus: ZenohBus) -> None:
    found, one = bus.subscribe("t/*", history=True), bus.publisher("t/one", cache=_STREAM)
    plain = bus._session.declare_subscriber("t/one")
    one.put(b"0")
    info = plain.recv().source_info
    assert info is not None
    for number in (0, 7):  # as if some were missing between them
        bus._session.put("t/*", b"many", source_info=zenoh.SourceInfo(info.source_id, number))
    one.put(b"1")
    payloads = list[bytes]()

    def all_came() -> bool:
        payloads.extend(message.payload for message in found.drain(9, 0.1))
        return len(payloads) == 4

    eventually(all_came)
    assert sorted(payloads) == [b"0", b"1", b"many", b"many"]


@pytest.mark.parametrize("cache", [_STREAM, 1])
def test_it_is_told_soon_then_now_and_then_and_not_for_ever(bus: ZenohBus, cache: int) -> None:
    one = bus.publisher("t/one", cache=cache)
    assert isinstance(one, _Publisher)
    assert not one.due(time.monotonic()), "nothing was put"
    one._put_s, now, told = 1000.0, 1000.0, list[float]()
    while now < 1060.0:
        now += _HEARTBEAT_S
        if one.due(now):
            told.append(now - 1000.0)
            one._told_s = now
    if cache == _STREAM:
        assert told.pop(0) == _HEARTBEAT_S
    assert told[0] <= _HEARTBEAT_S + _REPEAT_S
    assert {after - before for before, after in pairwise(told)} == {_REPEAT_S}
    assert _REPEATED_S - _REPEAT_S <= told[-1] < _REPEATED_S
    one._put_s = 1060.0
    assert one.due(1060.0 + _HEARTBEAT_S) is (cache == _STREAM)
