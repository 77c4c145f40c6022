"""Who is let in: enrolled devices from their own bridges. Others are listed, some of them, and cost nothing more."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from bridge.config.enrolment import Enrolment
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, State
from bridge.wire.refusal import Tally
from estimator.client import Client
from estimator.config.schema import Estimator
from estimator.service import enrolment_gate as rules
from estimator.service.device_roster import MAX_DEVICES
from estimator.service.enrolment_gate import FOREIGN, STRANGER, EnrolmentGate
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.stream import calibration, info
from tests.memory_bus import MemoryBroker, MemoryBus

ASKED = Command("r", "nurse", "")
ENROLLED = Enrolment(enrolled=("chest", "b1/wrist"))


def sent(bridge: str, device: str) -> tuple[str, str]:
    return bridge, device


def admit(gate: EnrolmentGate, sent: list[tuple[str, str]], now: float) -> list[tuple[str, str]]:
    return [one for one in sent if gate.admits(*one, now)]


@pytest.fixture
def counts() -> Tally:
    return Tally()


@pytest.fixture
def gate(counts: Tally) -> EnrolmentGate:
    return EnrolmentGate(ENROLLED, counts)


def test_without_an_enrolment_all_are_let_in(counts: Tally) -> None:
    gate, messages = EnrolmentGate(None, counts), [sent("b1", "x"), sent("b2", "y")]
    assert admit(gate, messages, 0.0) == messages
    assert gate.why("x") == ()


def test_only_enrolled_devices_from_their_own_bridges_are_let_in(gate: EnrolmentGate, counts: Tally) -> None:
    let_in = [sent("b1", "chest"), sent("b2", "chest"), sent("b1", "wrist")]
    assert admit(gate, [*let_in, sent("b2", "wrist"), sent("b1", "ghost"), sent("b1", "ghost")] * 2, 0.0) == let_in * 2
    assert counts.as_dict() == {FOREIGN: 2, STRANGER: 4}
    assert gate.strangers["ghost"].messages == 4


def test_a_hundred_thousand_invented_devices_take_no_more_room_than_a_few(gate: EnrolmentGate, counts: Tally) -> None:
    for n in range(100_000):
        assert admit(gate, [sent(f"b{n % 7}", f"ghost-{n}"), sent(f"b{n}", "chest")], n * 1e-4) == [
            sent(f"b{n}", "chest")
        ]
    assert counts.as_dict() == {STRANGER: 100_000}
    assert len(gate.strangers) == rules.LISTED
    assert rules.LISTED < MAX_DEVICES
    gate.look(10.0 + rules.LISTED_S)
    assert gate.strangers == {}, "who is not heard any more makes room for others"


def test_a_changed_table_holds_at_once(gate: EnrolmentGate) -> None:
    admit(gate, [sent("b1", "ankle")], 0.0)
    gate.enrol(Enrolment(enrolled=("chest", "ankle")))
    assert gate.strangers == {}
    assert admit(gate, [sent("b1", name) for name in ("chest", "wrist", "ankle")], 1.0) == [
        sent("b1", "chest"),
        sent("b1", "ankle"),
    ]


def test_a_service_lists_strangers_and_takes_them_once_they_are_enrolled(tmp_path: Path) -> None:
    broker = MemoryBroker()
    bridge, store = MemoryBus(broker), Store(tmp_path / "s.sqlite3")
    bus = MemoryBus(broker)
    service = Service("w", Estimator(id="e"), bus, store, enrolment=Enrolment(enrolled=("wrist",)))
    client = Client(ward="w", bus=MemoryBus(broker))
    raw = bridge.publisher(keys.build("w", "raw", bridge="b1", device="chest"), cache=0)
    told = bridge.publisher(keys.build("w", "info", bridge="b1", device="chest"), cache=0)
    batches = [codec.encode_samples(replace(one, device="chest")) for one in calibration(seed=1).batches()[:20]]
    told.put(codec.encode_info(replace(info(1), device="chest", bridge="b1")))
    for payload in batches[:10]:
        raw.put(payload)
    service.step(0.0)
    service._every_second(time.monotonic())
    service.work()
    said = client.statuses(0.05)["chest"]
    assert (said.state, said.events) == (State.UNKNOWN, {STRANGER: 11})
    assert service._devices == {}
    assert service._devices.info("b1", "chest") is None
    key = keys.parse(keys.build("w", "rpc", device="chest", verb="cancel"))
    replies = list[CommandReply]()
    service._commands.do(key, ASKED, replies.append)
    assert replies[0].message == (Code.NOT_ENROLLED(),)
    assert client.corrected(idle_s=0.05).receive(0.05) is None
    service._gate.enrol(Enrolment(enrolled=("wrist", "b1/chest")))
    service._every_second(time.monotonic())
    service.work()
    for payload in batches[10:]:
        raw.put(payload)
    service.step(0.0)
    service._every_second(time.monotonic())
    service.work()
    said = client.statuses(0.05)["chest"]
    assert (said.samples_in, said.samples_out) == (100, 100)
    bus.close()
    bridge.close()
    store.close()
