from dataclasses import replace

import pytest

from bridge.bus.contract import BusError, Publisher, Reply
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, CorrectedBatch, Quality
from estimator.client.client import Client
from estimator.device.session import DeviceSession
from tests.estimator.client.test_revision import revision
from tests.estimator.device.test_correction import CALIBRATION, chosen
from tests.estimator.stream import NAME, corrected_by, info, stream
from tests.memory_bus import MemoryBroker, MemoryBus
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


@pytest.mark.parametrize("by_bus", [False, True])
def test_iterating_ends_when_it_is_closed(broker: MemoryBroker, by_bus: bool) -> None:
    bus = MemoryBus(broker)
    subscription = Client(ward=WARD, bus=bus).corrected()
    (bus if by_bus else subscription).close()
    assert list(subscription) == []


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
    found = client.follow_infos().receive(30.0)
    assert found is not None
    assert found.model == "m"
    assert [c.id for c in client.follow_calibrations(NAME).drain(0.1)] == ["c1"]
    follow = client.follow(NAME)
    assert follow.latest() is not None
    assert follow.latest() is None
    follow.close()


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

    def answer(key: str, payload: bytes, reply: Reply) -> None:
        command = codec.decode_command(key, payload)
        asked.append((keys.parse(key).ids["verb"], command))
        reply(codec.encode_reply(CommandReply(command.request_id, accepted=True, message=free("so be it"))))

    MemoryBus(broker).answer(keys.pattern(WARD, "rpc"), answer)
    assert client.recalibrate(NAME, "nurse", "strap").message == free("so be it")
    client.cancel(NAME, "nurse")
    client.note(NAME, "nurse", "fell down")
    assert [verb for verb, _ in asked] == ["recalibrate", "cancel", "note"]
    assert len({command.request_id for _, command in asked}) == 3
    assert (asked[2][1].who, asked[2][1].reason) == ("nurse", "fell down")


def test_nobody_there_or_nonsense_is_a_bus_error(broker: MemoryBroker, client: Client) -> None:
    with pytest.raises(BusError, match=f"no estimator answers in ward {WARD}: name the right ward"):
        client.recalibrate(NAME, "nurse")
    MemoryBus(broker).answer(keys.pattern(WARD, "rpc"), lambda _key, _payload, reply: reply(b"\xff\xff"))
    with pytest.raises(BusError, match="answer to recalibrate is invalid"):
        client.recalibrate(NAME, "nurse")
