"""Who is let in: enrolled devices from their own bridges. Others are listed, some of them, and cost nothing more."""

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bridge.bus.contract import Message
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.enrolled import Enrolment
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, State, Status
from bridge.wire.refusal import Tally
from estimator import glance
from estimator.client import Client
from estimator.config import Estimator
from estimator.service import gate as rules
from estimator.service.gate import FOREIGN, STRANGER, Gate, Notices
from estimator.service.roster import MAX_DEVICES
from estimator.service.shell import Service
from estimator.service.store import Store
from estimator.ward_view import WardView
from tests.estimator.stream import calibration, info
from tests.sentences import codes

ASKED = Command("r", "nurse", "")
ENROLLED = Enrolment(enrolled=("chest", "b1/wrist"))


def sent(bridge: str, device: str) -> Message:
    return Message(keys.build("w", "raw", bridge=bridge, device=device), b"")


@pytest.fixture
def counts() -> Tally:
    return Tally()


@pytest.fixture
def gate(counts: Tally) -> Gate:
    return Gate(ENROLLED, counts)


def test_without_an_enrolment_all_are_let_in(counts: Tally) -> None:
    gate, messages = Gate(None, counts), [sent("b1", "x"), sent("b2", "y")]
    assert gate.admit(messages, 0.0) is messages
    assert gate.why("x") == ()


def test_only_enrolled_devices_from_their_own_bridges_are_let_in(gate: Gate, counts: Tally) -> None:
    let_in = [sent("b1", "chest"), sent("b2", "chest"), sent("b1", "wrist")]
    assert gate.admit([*let_in, sent("b2", "wrist"), sent("b1", "ghost"), sent("b1", "ghost")] * 2, 0.0) == let_in * 2
    assert counts.as_dict() == {FOREIGN: 2, STRANGER: 4}
    assert gate.strangers["ghost"].messages == 4


def test_keys_that_are_none_are_left_to_the_door_that_says_why(gate: Gate, counts: Tally) -> None:
    strange = [
        Message(key, b"") for key in ("**", "truerate/**", "truerate/@v1/w/raw/b1/*", "truerate/@v1/w/raw/*/wrist", "")
    ]
    assert gate.admit(strange, 0.0) == strange
    assert counts.as_dict() == {}


def test_a_hundred_thousand_invented_devices_take_no_more_room_than_a_few(gate: Gate, counts: Tally) -> None:
    for n in range(100_000):
        assert gate.admit([sent(f"b{n % 7}", f"ghost-{n}"), sent(f"b{n}", "chest")], n * 1e-4) == [
            sent(f"b{n}", "chest")
        ]
    assert counts.as_dict() == {STRANGER: 100_000}
    assert len(gate.strangers) == rules.LISTED
    assert len(gate._known) <= rules._KNOWN
    assert rules.LISTED < MAX_DEVICES
    gate.look(10.0 + rules.LISTED_S)
    assert gate.strangers == {}, "who is not heard any more makes room for others"


def test_the_file_is_read_again_when_it_changes_and_kept_when_it_is_broken(
    tmp_path: Path, counts: Tally, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "enrolled.txt"
    file.write_text("# of bay 2\nb1/wrist\n\nchest  # spare\n")
    gate = Gate(Enrolment(enrolled=("hip",), file=str(file)), counts)
    all_three = [sent("b1", "wrist"), sent("b1", "chest"), sent("b1", "hip")]
    assert gate.admit([*all_three, sent("b1", "ankle")], 0.0) == all_three
    for n, (text, let_in) in enumerate(
        (("ankle\n", ["hip", "ankle"]), ("../x\n", ["hip", "ankle"]), ("wrist\n", ["hip", "wrist"]))
    ):
        file.write_text(text)
        os.utime(file, ns=(n, n))
        gate.look(1.0)
        found = gate.admit([sent("b1", name) for name in ("chest", "hip", "ankle", "wrist")], 1.0)
        assert [message.key.rpartition("/")[2] for message in found] == let_in
        assert "ankle" not in gate.strangers or n == 2
    assert caplog.text.count("what was enrolled before stays so") == 1
    file.unlink()
    gate.look(2.0)
    assert gate.admit([sent("b1", "wrist")], 2.0), "a file that is gone for a moment throws nobody out"


@pytest.mark.parametrize("by_hand", [(), ("hip", "b1/ankle")])
def test_a_list_that_is_suddenly_empty_throws_nobody_out(
    by_hand: tuple[str, ...], tmp_path: Path, counts: Tally, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "enrolled.txt"
    file.write_text("chest\n")
    gate = Gate(Enrolment(enrolled=by_hand, file=str(file)), counts)
    for text in ("", "# none\n"):
        file.write_text(text)
        gate.look(1.0)
        assert gate.admit([sent("b1", "chest")], 1.0)
    assert caplog.text.count("no device of its own stands in it any more; what was enrolled before stays so") == 2
    file.write_bytes(b"\xef\xbb\xbfwrist\r\n")  # as some editors write it
    gate.look(2.0)
    assert gate.why("wrist") == ()
    file.unlink()
    os.mkfifo(file)
    gate.look(3.0)
    assert "not a file; what was enrolled before stays so" in caplog.text


def test_of_an_enrolled_device_that_another_bridge_sends_it_is_said(gate: Gate) -> None:
    bus = MemoryBus(MemoryBroker())
    heard, notices = bus.subscribe(keys.pattern("w", "status")), Notices(bus, "w", gate)

    def said() -> list[str]:
        notices.say(5, ())
        return [english(*codec.decode_status(*message).reason) for message in heard.drain(9, 0.0)]

    gate.admit([sent("b2", "wrist")], 0.0)
    (reason,) = said()
    assert reason.startswith("The device is enrolled by b1 and sent by b2: ")
    gate.admit([sent("b1", "wrist"), sent("b2", "wrist")], 1.0)
    gate.look(1.0)
    assert said() == [], "its own bridge is heard: somebody has it, and speaks of it"
    notices.close()
    bus.close()


def test_a_file_that_changes_while_it_is_read_is_read_again(
    tmp_path: Path, counts: Tally, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "enrolled.txt"
    file.write_text("chest\n")
    enrolment = Enrolment(file=str(file))

    def just_then(self: Enrolment) -> dict[str, str]:
        found = read(self)
        file.write_text("chest\nwrist\n")
        return found

    read = Enrolment.read
    with monkeypatch.context() as patch:
        patch.setattr(Enrolment, "read", just_then)
        gate = Gate(enrolment, counts)
    gate.look(1.0)
    assert gate.why("wrist") == ()


@pytest.fixture
def status() -> Iterator[tuple[Notices, Gate, list[Status]]]:
    gate, bus = Gate(ENROLLED, Tally()), MemoryBus(MemoryBroker())
    heard = bus.subscribe(keys.pattern("w", "status"))
    notices, said = Notices(bus, "w", gate), list[Status]()

    class Said(list[Status]):
        def __iter__(self) -> Iterator[Status]:
            return (codec.decode_status(*message) for message in heard.drain(1000, 0.0))

    yield notices, gate, Said()
    notices.close()
    bus.close()
    assert said == []


def test_a_stranger_stands_in_every_list_as_not_enrolled(status: tuple[Notices, Gate, list[Status]]) -> None:
    notices, gate, said = status
    gate.admit([sent("b9", "ghost"), sent("b9", "listed")], 0.0)
    notices.say(5, {"listed"})
    (one,) = said
    assert (one.device, one.bridge, one.events, one.samples_in) == ("ghost", "b9", {STRANGER: 1}, 0)
    assert one.reason == (Code.NOT_ENROLLED(),)
    seen = glance.glance("w", {"ghost": one}, {}, ["b9"], ["e"])
    assert (seen.needs[0].device, seen.needs[0].reason, seen.well) == ("ghost", one.reason, False)
    view = WardView()
    view.take_status(one, 0.0)
    (row,) = view.rows(0.0)
    assert (row.state, row.reason) == ("unknown", one.reason)
    gate.look(rules.LISTED_S + 1.0)
    notices.say(6, ())
    assert list(said) == []
    assert notices._publishers == {}


def test_a_device_that_is_enrolled_no_more_is_lost_for_that_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estimator.service.shell.SLOW_S", 0.0)  # as on a busy machine: its first round takes long
    file = tmp_path / "enrolled.txt"
    file.write_text("chest\nwrist\n")
    broker = MemoryBroker()
    bridge, store = MemoryBus(broker), Store(tmp_path / "s.sqlite3")
    buses = MemoryBus(broker), MemoryBus(broker)
    service = Service("w", Estimator(id="e", silence_s=0.2), *buses, store, enrolment=Enrolment(file=str(file)))
    raw = bridge.publisher(keys.build("w", "raw", bridge="b1", device="chest"), cache=0)
    told = bridge.publisher(keys.build("w", "info", bridge="b1", device="chest"), cache=0)
    told.put(codec.encode_info(replace(info(1), device="chest", bridge="b1")))
    raw.put(codec.encode_samples(replace(calibration(seed=1).batches()[0], device="chest")))
    service.step(0.0)
    assert service._devices["chest"].heard <= time.monotonic(), "nobody is heard later than now"
    file.write_text("wrist\n")
    time.sleep(0.25)
    for _ in range(2):
        service._every_second(time.monotonic())
        service.work()
    said = Client(ward="w", bus=MemoryBus(broker)).statuses(0.05)["chest"]
    assert said.state is State.LOST
    assert Code.NOT_ENROLLED in codes(said.reason)
    for bus in (*buses, bridge):
        bus.close()
    store.close()


def test_a_service_lists_strangers_and_takes_them_once_they_are_enrolled(tmp_path: Path) -> None:
    file = tmp_path / "enrolled.txt"
    file.write_text("wrist\n")
    broker = MemoryBroker()
    bridge, store = MemoryBus(broker), Store(tmp_path / "s.sqlite3")
    buses = MemoryBus(broker), MemoryBus(broker)
    service = Service("w", Estimator(id="e"), *buses, store, enrolment=Enrolment(file=str(file)))
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
    assert service._orders.do(key, ASKED, lambda: None).message == (Code.NOT_ENROLLED(),)
    assert client.corrected(idle_s=0.05).receive(0.05) is None
    file.write_text("wrist\nb1/chest\n")
    service._every_second(time.monotonic())
    service.work()
    for payload in batches[10:]:
        raw.put(payload)
    service.step(0.0)
    service._intake.give_up()
    service._every_second(time.monotonic())
    service.work()
    said = client.statuses(0.05)["chest"]
    assert (said.samples_in, said.samples_out) == (100, 100)
    for bus in (*buses, bridge):
        bus.close()
    store.close()
