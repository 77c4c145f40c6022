import threading
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.contract import BusError, Publisher
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, CorrectedBatch, Quality
from bridge.wire.refusal import Refusal
from estimator.client.client import NONE_S, Client
from estimator.session import DeviceSession
from tests.estimator.client.test_revision import revision
from tests.estimator.stream import NAME, corrected_by, info, stream
from tests.estimator.test_correction import CALIBRATION, chosen
from tests.sentences import free

WARD = "w"


@pytest.fixture
def broker() -> MemoryBroker:
    return MemoryBroker()


@pytest.fixture
def client(broker: MemoryBroker) -> Client:
    return Client(ward=WARD, bus=MemoryBus(broker))


def corrected(start: int, end: int, boot: int = 1) -> CorrectedBatch:
    (batch,) = stream([], 3.0).part(start, end).batches([], boot=boot, first=start)
    return corrected_by(chosen(CALIBRATION), batch)


def publisher(broker: MemoryBroker, what: str = "corrected") -> Publisher:
    return MemoryBus(broker).publisher(keys.build(WARD, what, device=NAME), cache=100)


def numbers(batches: list[CorrectedBatch]) -> list[int]:
    return [n for b in batches for n in range(b.sequence, b.sequence + len(b))]


def test_every_sample_once_the_past_first(broker: MemoryBroker, client: Client) -> None:
    put = publisher(broker).put
    put(codec.encode_corrected(corrected(0, 20)))
    subscription = client.corrected(idle_s=0.1)
    put(codec.encode_corrected(corrected(20, 30)))
    found = list(subscription)
    assert numbers(found) == list(range(30))
    assert found[0].quality is Quality.GOOD
    assert subscription.repeated == subscription.missed == 0
    assert list(client.corrected(history=False, idle_s=0.05)) == []


def test_what_a_restarted_estimator_corrects_again_is_left_out(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected(NAME, idle_s=0.1)
    put = publisher(broker).put
    for start, end in [(0, 50), (50, 100), (30, 60), (60, 90), (80, 130), (130, 140)]:
        put(codec.encode_corrected(corrected(start, end)))
    found = list(subscription)
    assert numbers(found) == list(range(140))
    assert subscription.repeated == 30 + 30 + 20
    # A batch cut at its head keeps its own times.
    tail = next(b for b in found if b.sequence == 100)
    whole = corrected(80, 130)
    np.testing.assert_array_equal(tail.rate, whole.rate[20:])
    assert np.abs(tail.sample_time_ns - whole.sample_time_ns[20:]).max() <= 1


def test_a_new_boot_counts_from_its_own_start(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected(idle_s=0.1)
    put = publisher(broker).put
    for batch in (corrected(0, 50), corrected(0, 20, boot=2), corrected(50, 60), corrected(20, 30, boot=2)):
        put(codec.encode_corrected(batch))
    found = list(subscription)
    assert [(b.boot, b.sequence, len(b)) for b in found] == [(1, 0, 50), (2, 0, 20), (1, 50, 10), (2, 20, 10)]


def test_a_gap_is_a_gap_and_no_repeat(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected(idle_s=0.1)
    put = publisher(broker).put
    for start, end in [(0, 10), (30, 40)]:
        put(codec.encode_corrected(corrected(start, end)))
    assert numbers(list(subscription)) == [*range(10), *range(30, 40)]
    assert subscription.repeated == subscription.missed == 0


def test_a_device_started_anew_under_its_old_boot_number_is_heard(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected(idle_s=0.1)
    put = publisher(broker).put
    put(codec.encode_corrected(corrected(0, 50)))
    for start, end in [(0, 10), (10, 60)]:
        batch = corrected(start, end)
        put(codec.encode_corrected(replace(batch, start_time_ns=batch.start_time_ns + 4_000_000_000)))
    assert numbers(list(subscription)) == [*range(50), *range(60)]
    assert subscription.repeated == 0


@pytest.mark.parametrize("by_bus", [False, True])
def test_iterating_ends_when_it_is_closed(broker: MemoryBroker, by_bus: bool) -> None:
    bus = MemoryBus(broker)
    subscription = Client(ward=WARD, bus=bus).corrected()
    (bus if by_bus else subscription).close()
    assert list(subscription) == []


def test_closed_within_a_loop_it_ends_there(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected()
    put = publisher(broker).put
    for start in (0, 10, 20):
        put(codec.encode_corrected(corrected(start, start + 10)))
    found = []
    for batch in subscription:
        found.append(batch)
        subscription.close()
    assert numbers(found) == list(range(10))


def test_garbage_is_counted_and_passed_over(broker: MemoryBroker, client: Client) -> None:
    subscription = client.corrected(idle_s=0.1)
    put = publisher(broker).put
    put(b"\xff\xfe")
    put(codec.encode_corrected(replace(corrected(0, 10), device="other")))
    put(codec.encode_corrected(corrected(0, 10)))
    assert numbers(list(subscription)) == list(range(10))
    assert sum(subscription.refused.values()) == 2


def test_statuses_infos_and_calibrations(broker: MemoryBroker, client: Client) -> None:
    publisher(broker, "status").put(codec.encode_status(DeviceSession(NAME).status(7)))
    publisher(broker, "calibration").put(codec.encode_calibration(CALIBRATION))
    MemoryBus(broker).publisher(keys.build(WARD, "info", bridge="bridge", device=NAME), cache=1).put(
        codec.encode_info(info())
    )
    assert client.statuses(0.1)[NAME].time_ns == 7
    assert client.statuses(0.1, "other") == {}
    found = client.follow_infos().receive(0.1)
    assert found is not None
    assert found.model == "m"
    assert [c.id for c in client.follow_calibrations(NAME).drain(0.1)] == ["c1"]
    follow = client.follow(NAME)
    assert follow.latest() is not None
    assert follow.latest() is None
    follow.close()


def test_a_status_of_an_estimator_that_has_lost_the_device_is_left_out(
    broker: MemoryBroker, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    put, follow = publisher(broker, "status").put, client.follow(NAME)
    for epoch in (5, 4, 6, 5):
        put(codec.encode_status(replace(DeviceSession(NAME).status(7), epoch=epoch)))
    assert [status.epoch for status in follow.drain(0.1)] == [5, 6]
    monkeypatch.setattr("estimator.client.client.HANDOVER_S", 0.0)  # the clock that epochs are made of was set back
    put(codec.encode_status(replace(DeviceSession(NAME).status(7), epoch=1)))
    assert [status.epoch for status in follow.drain(0.1)] == [1]


def test_who_is_slow_to_show_that_he_is_there_is_not_said_to_be_gone(broker: MemoryBroker, client: Client) -> None:
    key = keys.build(WARD, "alive/estimator", estimator="e")
    timer = threading.Timer(0.2, lambda: MemoryBus(broker).declare_alive(key))
    timer.start()
    assert client.alive("estimator", 0.0) == ["e"]
    timer.join()
    began = time.monotonic()
    assert client.alive("bridge", 0.0) == []
    assert time.monotonic() - began >= NONE_S


def test_revisions_come_as_they_are_made(broker: MemoryBroker, client: Client) -> None:
    put = publisher(broker, "revision").put
    put(codec.encode_revision(replace(revision(), device=NAME, reason=free("first"))))
    revisions = client.revisions(NAME, idle_s=0.1)
    put(b"\xff\xfe")
    put(codec.encode_revision(replace(revision(), device=NAME, reason=free("second"))))
    assert [r.reason for r in revisions] == [free("first"), free("second")]
    assert sum(revisions.refused.values()) == 1
    assert revisions.missed == 0
    assert list(client.revisions(history=False, idle_s=0.05)) == []
    assert list(client.revisions("other", idle_s=0.05)) == []


def test_commands_reach_the_estimator_and_bring_back_its_word(broker: MemoryBroker, client: Client) -> None:
    asked: list[tuple[str, Command]] = []

    def answer(key: str, payload: bytes) -> bytes:
        command = codec.decode_command(key, payload)
        asked.append((keys.parse(key).ids["verb"], command))
        return codec.encode_reply(CommandReply(command.request_id, accepted=True, message=free("so be it")))

    MemoryBus(broker).answer(keys.pattern(WARD, "rpc"), answer)
    assert client.recalibrate(NAME, "nurse", "strap").message == free("so be it")
    client.cancel(NAME, "nurse")
    client.note(NAME, "nurse", "fell down")
    assert [verb for verb, _ in asked] == ["recalibrate", "cancel", "note"]
    assert len({command.request_id for _, command in asked}) == 3
    assert (asked[2][1].who, asked[2][1].reason) == ("nurse", "fell down")


def test_nobody_there_or_nonsense_is_a_bus_error(broker: MemoryBroker, client: Client) -> None:
    with pytest.raises(BusError, match=f"no estimator answers in ward {WARD}; is one running"):
        client.recalibrate(NAME, "nurse")
    MemoryBus(broker).answer(keys.pattern(WARD, "rpc"), lambda *_: b"\xff\xff")
    with pytest.raises(BusError, match="not understood"):
        client.recalibrate(NAME, "nurse")


def test_a_bad_name_goes_nowhere(client: Client) -> None:
    with pytest.raises(Refusal):
        client.recalibrate("a/b", "nurse")
    with pytest.raises(Refusal):
        client.corrected("*")
    with pytest.raises(Refusal):
        Client(ward="a/b", bus=MemoryBus(MemoryBroker()))


def test_a_bus_that_was_lent_is_not_closed(broker: MemoryBroker) -> None:
    bus = MemoryBus(broker)
    with Client(ward=WARD, bus=bus):
        pass
    assert bus.connected


def test_a_router_may_be_given_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Sequence[str]] = []

    def opened(endpoints: Sequence[str]) -> MemoryBus:
        asked.append(endpoints)
        return MemoryBus(MemoryBroker())

    monkeypatch.setattr("estimator.client.connection.ZenohBus", opened)
    Client("tcp/10.0.0.5:7447", ward=WARD)
    assert asked == [("tcp/10.0.0.5:7447",)]


def test_of_whom_nothing_comes_the_log_says_so_once(
    broker: MemoryBroker, client: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("estimator.client.stream.NOTHING_S", 0.05)
    publisher(broker).put(codec.encode_corrected(corrected(0, 20)))
    for names, said in (
        ("chst", "nothing has come yet of chst in ward w; are the names right?"),
        (["chst", "bakc"], "nothing has come yet of chst, bakc in ward w"),
        (NAME, ""),
        (None, ""),
    ):
        caplog.clear()
        stream = client.corrected(names, idle_s=0.2)
        assert bool(list(stream)) == (not said)
        assert list(stream) == []
        assert len(caplog.records) == bool(said)
        assert said in caplog.text
    caplog.clear()
    assert list(client.corrected("chst", idle_s=0.2, quiet=True)) == []
    assert not caplog.records
