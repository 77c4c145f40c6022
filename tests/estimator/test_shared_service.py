"""Two services on one bus, by hand: a calibrated device goes over to the other, as it was, and commands find who has it."""

import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import replace

import pytest

from bridge.bus.contract import Message, Subscription
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Command, CommandReply, CorrectedBatch, Quality, SampleBatch, State
from estimator.client import Client
from estimator.config import Estimator
from estimator.guide.reasons import Words, said
from estimator.service.orders import REPEATED
from estimator.service.ownership import owner
from estimator.service.peers import DOUBLE
from estimator.service.replicas import checkpoint_of
from estimator.service.shell import Service
from estimator.service.silent import SILENT
from estimator.service.store import Store
from tests.estimator.served import numbers
from tests.estimator.stream import NAME, calibration, info
from tests.estimator.test_replicas import calibrated

WARD = "w"
FIRST, SECOND = ("e1", "e2") if owner(NAME, ("e1", "e2")) == "e2" else ("e2", "e1")


class Both:
    """FIRST has the device while it is alone; it is SECOND's where both are there. The clock stands still but for `pass_`."""

    def __init__(self) -> None:
        self.now, self.now_ns = 1000.0, 1_700_000_100_000_000_000
        self.broker = MemoryBroker()
        self.buses: dict[str, tuple[MemoryBus, MemoryBus]] = {}
        self.services: dict[str, Service] = {}
        self.stores: dict[str, Store] = {}
        self.client = Client(ward=WARD, bus=MemoryBus(self.broker))
        self.stream = self.client.corrected(wait_s=1e9)
        bridge = self._asks = MemoryBus(self.broker)
        self._raw = bridge.publisher(keys.build(WARD, "raw", bridge="bridge", device=NAME), cache=500)
        self._kept = bridge.publisher(keys.build(WARD, "checkpoint", device=NAME), cache=1)
        self._info = bridge.publisher(keys.build(WARD, "info", bridge="bridge", device=NAME), cache=1)

    def start(self, name: str) -> None:
        self.buses[name] = data, control = MemoryBus(self.broker), MemoryBus(self.broker)
        self.stores[name] = Store(":memory:")
        self.services[name] = Service(
            WARD, Estimator(id=name), data, control, self.stores[name], lambda: self.now_ns, peers=[*self.services]
        )
        self.told()

    def kill(self, name: str) -> None:
        del self.services[name]
        for bus in self.buses.pop(name):
            bus.detach()
        self.told()

    def told(self) -> None:
        """Each service has heard of all tokens that were born or have died: on a thread of the bus, the last a probe."""
        probe = f"a-probe/{uuid.uuid4().hex}"
        for service in self.services.values():
            service._peers._watch._changes.put((probe, True))  # type: ignore[attr-defined] # of the bus in memory
        deadline = time.monotonic() + 10.0
        while not all((probe, True) in service._peers._tokens for service in self.services.values()):
            assert time.monotonic() < deadline
            time.sleep(0.001)
        for service in self.services.values():
            service._peers._tokens.remove((probe, True))

    def pass_(self, seconds: float, still: str = "") -> None:
        for _ in range(max(1, round(seconds / 0.1))):
            self.now, self.now_ns = self.now + 0.1, self.now_ns + 100_000_000
            for name, service in self.services.items():
                if name != still:
                    service.step(0.0)

    def send(self, batches: list[SampleBatch], still: str = "") -> None:
        self._info.put(codec.encode_info(info()))
        for at in range(0, len(batches), 20):
            for batch in batches[at : at + 20]:
                self._raw.put(codec.encode_samples(batch))
            self.pass_(0.1, still)

    def say_checkpoint(self, checkpoint: Checkpoint) -> None:
        """As another estimator would."""
        self._kept.put(codec.encode_checkpoint(checkpoint))

    def part(self) -> list["Cut"]:
        """What keeps either from hearing what the other has, until it is not cut any more."""
        lines = []
        for service in self.services.values():
            service._peers._heard = line = Cut(service._peers._heard)  # type: ignore[assignment]
            lines.append(line)
        return lines

    def has(self) -> list[str]:
        return [name for name, service in self.services.items() if NAME in service._devices]

    def command(self, verb: str = "note", request: str = "") -> CommandReply:
        """Ask, and let the services answer."""
        replies: list[CommandReply] = []
        key = keys.build(WARD, "rpc", device=NAME, verb=verb)
        payload = codec.encode_command(Command(request or uuid.uuid4().hex, "nurse", "sat up"))
        asking = threading.Thread(target=lambda: replies.append(codec.decode_reply(self._asks.ask(key, payload))))
        asking.start()
        while asking.is_alive():
            self.pass_(0.1)
            time.sleep(0.005)
        return replies[0]


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Iterator[Both]:
    made = Both()
    for module in ("shell", "peers", "device", "lane"):
        monkeypatch.setattr(f"estimator.service.{module}.time", Clock(made))
    yield made
    for pair in made.buses.values():
        for bus in pair:
            bus.close()


class Clock:
    """The module `time` as services see it."""

    def __init__(self, both: Both) -> None:
        self._both = both
        self.time_ns, self.process_time = time.time_ns, time.process_time

    def monotonic(self) -> float:
        return self._both.now


def test_it_goes_on_as_it_was_calibrated_and_all(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    worn = len(batches) - 120
    both.start(FIRST)
    both.send(batches[:worn])
    (made,) = both.stores[FIRST].calibrations(NAME)
    assert both.has() == [FIRST]

    both.start(SECOND)
    both.pass_(0.5)
    assert both.has() == [FIRST], "a newcomer looks round first"
    both.pass_(2.5)
    both.send(batches[worn : worn + 60])
    assert both.has() == [SECOND]
    assert [c.id for c in both.stores[SECOND].calibrations(NAME)] == [made.id]
    assert both.command().accepted

    both.kill(SECOND)
    both.send(batches[worn + 60 :])
    both.pass_(0.5)
    assert both.has() == [FIRST]
    assert both.command().accepted
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    moved = next(at for at, batch in enumerate(given) if batch.quality is Quality.GOOD)
    assert {(batch.quality, batch.calibration) for batch in given[moved:]} == {(Quality.GOOD, made.id)}
    assert len({batch.epoch for batch in given}) == 3
    statuses = both.client.statuses(0.1)
    assert statuses[NAME].epoch == given[-1].epoch
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())


def test_rates_of_a_device_that_is_taken_over_come_before_what_is_said_of_it(
    both: Both, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-20])
    assert both.has() == [SECOND]
    before = both.client.statuses(0.1)[NAME].epoch
    both.stream.drain()
    both.kill(SECOND)
    with monkeypatch.context() as busy:
        busy.setattr(both.services[FIRST]._quiet, "work", lambda: None)
        busy.setattr(both.services[FIRST], "_next_status", both.now + 10.0)
        both.send(batches[-20:])
        both.pass_(0.5)
    epochs = {batch.epoch for batch in both.stream.drain()}
    assert min(epochs) > before
    assert NAME not in both.client.statuses(0.1)
    both.pass_(0.1)
    assert both.client.statuses(0.1)[NAME].epoch == max(epochs)


def test_of_two_the_one_that_is_left_goes_on_at_once(both: Both) -> None:
    """Alone it waited for what came before the first that it had kept: a tenth of a second, of every device."""
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-2])
    both.stream.drain()
    both.kill(SECOND)
    for batch in batches[-2:]:
        both._raw.put(codec.encode_samples(batch))
        both.services[FIRST].step(0.0)
    assert both.has() == [FIRST]
    assert numbers(both.stream.drain())[-1][1] == sum(map(len, batches)) - 1


def test_who_is_gone_is_noticed_although_no_sample_comes(both: Both) -> None:
    """Who waited for the next sample, of batches of 50 ms, began to take over with that."""
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(calibration(seed=1).batches())
    assert both.has() == [SECOND]
    both.kill(SECOND)
    began = time.monotonic()
    both.services[FIRST].step(60.0)
    assert time.monotonic() - began < 30.0
    assert both.has() == [FIRST]


def test_what_an_estimator_has_does_not_wait_for_what_it_takes_over(both: Both) -> None:
    own = next(name for n in range(100) if owner(name := f"wrist-{n}", (FIRST, SECOND)) == FIRST)
    raw = MemoryBus(both.broker).publisher(keys.build(WARD, "raw", bridge="bridge", device=own), cache=500)
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    for batch in batches[:200]:
        raw.put(codec.encode_samples(replace(batch, device=own)))
    both.send(batches[:200])
    assert both.has() == [SECOND]
    heard = MemoryBus(both.broker).subscribe(keys.pattern(WARD, "corrected"))
    both.kill(SECOND)
    both._raw.put(codec.encode_samples(batches[200]))
    raw.put(codec.encode_samples(replace(batches[200], device=own)))
    both.services[FIRST].step(0.0)
    said = [keys.parse(message.key).device for message in heard.drain(1000, 0.0)]
    assert said[0] == own
    assert said.count(own) == 1
    assert said.count(NAME) > 1


def test_who_starts_takes_nothing_before_it_has_what_bridges_kept(both: Both) -> None:
    """Taken with the first of it, all of fifteen seconds was corrected and said again."""
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    worn = len(batches) - 120
    both.start(FIRST)
    both.send(batches[:worn])
    both.stream.drain()
    both.start(SECOND)
    past = both.services[SECOND]._raw
    both.services[SECOND]._raw = Cut(past)  # type: ignore[assignment]
    both.send(batches[worn : worn + 40])
    both.pass_(3.0)
    assert both.has() == [FIRST]
    both.services[SECOND]._raw = past
    both.pass_(1.0)
    both.send(batches[worn + 40 :])
    assert both.has() == [SECOND]
    assert [n for _, n in numbers(both.stream.drain())] == list(range(10 * worn, sum(map(len, batches))))
    assert both.stream.repeated < 500


class Cut:
    """A subscription over a line on which nothing passes for a while; what was said meanwhile comes when it is whole again."""

    def __init__(self, whole: Subscription) -> None:
        self._whole, self.cut = whole, True

    def __getattr__(self, name: str) -> object:
        return getattr(self._whole, name)

    @property
    def caught_up(self) -> bool:
        return not self.cut

    def drain(self, limit: int, timeout_s: float) -> Sequence[Message]:
        return [] if self.cut else self._whole.drain(limit, timeout_s)


def test_what_nobody_listened_to_is_said_again_where_it_was_not_said_by_who_had_the_device(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(60.0)]).batches()
    worn = len(batches) - 800  # calibrated
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:worn])
    assert both.has() == [SECOND]
    lines = both.part()
    both.send(batches[worn : worn + 600])
    assert sorted(both.has()) == sorted([FIRST, SECOND]), "neither hears the other"
    both.services[FIRST]._raw = Cut(both.services[FIRST]._raw)  # type: ignore[assignment]
    both.send(batches[worn + 600 : worn + 700])  # SECOND says them; who has heard FIRST does not listen
    for line in lines:
        line.cut = False
    both.send(batches[worn + 700 :])
    both.pass_(4.0)
    assert both.has() == [SECOND]
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    epochs = [batch.epoch for batch in given]
    assert epochs == sorted(epochs)
    assert len(set(epochs)) == 3
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())


def test_who_has_a_device_and_hears_nothing_of_it_does_not_keep_it(both: Both) -> None:
    """It took it while lines were bad; they carry what it says since, and nothing of what the bridge does."""
    batches = calibration(seed=1, after=[Still(60.0)]).batches()
    worn = len(batches) - 800  # calibrated
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:worn])
    cluster = both.services[SECOND]._peers.cluster
    cluster.knobs = replace(cluster.knobs, retry_s=30.0)  # as after the third time
    lines = both.part()
    both.send(batches[worn : worn + 600])
    assert sorted(both.has()) == sorted([FIRST, SECOND]), "neither hears the other"
    both.services[FIRST]._raw = Cut(both.services[FIRST]._raw)  # type: ignore[assignment]
    for line in lines:
        line.cut = False
    for at in range(worn + 600, len(batches), 2):
        both.send(batches[at : at + 2])
    assert both.has() == [SECOND]
    assert both.services[SECOND]._peers._moves[-1].reason == "shared out anew"
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    epochs = [batch.epoch for batch in given]
    assert epochs == sorted(epochs)
    assert len(set(epochs)) == 3


def test_without_a_router_all_stays_as_it_is(both: Both) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    batches = calibration(seed=1).batches()
    both.send(batches[:40])
    both.pass_(1.2)
    assert both.has() == [SECOND]
    epochs = {name: dict(service._peers.cluster.held) for name, service in both.services.items()}
    both.broker.stop()
    both.told()
    both.pass_(10.0)
    both.broker.start()
    both.told()
    both.send(batches[40:80])
    both.pass_(4.0)
    assert {name: service._peers.cluster.held for name, service in both.services.items()} == epochs


def test_turns_are_not_lost_when_an_estimator_comes(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[: len(batches) // 3])
    assert both.client.statuses(0.1)[NAME].axes_done
    both.start(SECOND)
    both.pass_(3.0)
    assert both.has() == [FIRST]
    both.send(batches[len(batches) // 3 :])
    both.pass_(1.2)
    assert both.has() == [SECOND]
    status = both.client.statuses(0.1)[NAME]
    assert status.state is State.TRACKING
    assert "turns lost with an estimator" not in status.events
    (made,) = both.stores[FIRST].calibrations(NAME)
    assert status.calibration == made.id


def test_who_hears_nothing_at_all_takes_nobody_for_gone(both: Both) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(9.0)  # neither has just come
    both.send(batches[:40])
    assert both.has() == [SECOND]
    both.pass_(5.0, still=SECOND)
    assert both.has() == [SECOND]
    both.send(batches[40:400], still=SECOND)  # somebody is heard, and it is not SECOND
    assert both.has() == [FIRST, SECOND]


def test_turns_that_were_taken_by_another_are_said_to_be_lost(both: Both) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[: len(batches) * 2 // 3])
    assert both.has() == [SECOND]
    done = both.client.statuses(0.1)[NAME].axes_done
    assert done
    both.kill(SECOND)
    both.send(batches[len(batches) * 2 // 3 : -60])
    status = both.client.statuses(0.1)[NAME]
    assert both.has() == [FIRST]
    assert status.events["turns lost with an estimator"] == len(done)
    axes = ", ".join("xyz"[axis] for axis in done)
    assert said(status.reason)[-1] == Words("moved", {"axes": axes})


def test_a_calibration_by_who_did_not_know_yet_that_it_had_lost_the_device_counts(both: Both) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[: len(batches) // 2])
    assert both.has() == [SECOND]
    late = checkpoint_of(calibrated()[0], both.now_ns)
    assert late is not None
    assert late.calibration is not None
    both.say_checkpoint(replace(late, epoch=7))
    both.pass_(1.2)
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING
    assert both.client.statuses(0.1)[NAME].calibration == late.calibration.id
    assert [c.id for c in both.stores[SECOND].calibrations(NAME)] == [late.calibration.id]


def test_of_a_silent_device_whoever_takes_over_goes_on_to_speak(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(8.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-20])
    both.pass_(30.0)
    before = both.client.statuses(0.1)[NAME]
    assert before.state is State.LOST
    both.kill(SECOND)
    both.pass_(3.0)
    after = both.client.statuses(0.1)[NAME]
    assert (after.state, after.boot, after.calibration) == (State.LOST, before.boot, before.calibration)
    assert after.epoch > before.epoch
    assert both.command().message == f"{NAME}: {SILENT}"
    # It is heard again: by who speaks of it, and as it was.
    both.send(batches[-20:])
    both.pass_(1.2)  # all say their status once a second
    assert both.has() == [FIRST]
    heard = both.client.statuses(0.1)[NAME]
    assert (heard.state, heard.calibration) == (State.TRACKING, before.calibration)
    assert NAME not in both.services[FIRST]._silent


def test_what_moved_is_not_put_down_to_who_went_long_before(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-60])
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[-60:])
    assert both.has() == [SECOND]
    reasons = [move.reason for move in both.services[SECOND]._peers._moves]
    assert reasons == ["shared out anew"], "another had it, so it was not heard for the first time"
    third = MemoryBus(both.broker)
    token = third.declare_alive(keys.build(WARD, "alive/estimator", estimator="e9"))
    both.told()
    both.pass_(0.5)
    token.close()
    both.told()
    both.pass_(5.0)
    for service in both.services.values():
        assert service._peers._why == ""
    third.close()


def test_a_command_that_is_sent_again_after_its_device_has_moved_does_nothing(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-120])
    asked, cancelled = both.command("recalibrate", "r1"), both.command("cancel", "r2")
    assert (asked.accepted, cancelled.accepted) == (True, True)

    both.start(SECOND)
    both.pass_(2.5)
    both.send(batches[-120:-60])
    assert both.has() == [SECOND]
    assert (both.command("recalibrate", "r1"), both.command("cancel", "r2")) == (asked, cancelled)
    assert both.services[SECOND].counts.as_dict()[REPEATED] == 2
    assert both.command("cancel", "r1").accepted is False, "another verb is another command"

    both.kill(SECOND)
    both.send(batches[-60:])
    both.pass_(1.5)
    assert both.has() == [FIRST]
    assert both.command("recalibrate", "r1") == asked
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING


def test_an_answer_is_known_to_the_others_before_it_is_given(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.send(batches[:-60])
    assert both.has() == [SECOND]
    asked = both.command("recalibrate", "r1")
    both.kill(SECOND)
    both.send(batches[-60:])
    both.pass_(2.0)
    assert both.has() == [FIRST]
    assert both.command("cancel", "r2").accepted
    assert both.command("recalibrate", "r1") == asked
    assert both.client.statuses(0.1)[NAME].state is State.TRACKING


def test_two_of_one_id_are_told_of_each_other(both: Both, caplog: pytest.LogCaptureFixture) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
    alone = both.services[FIRST]
    double = Service(WARD, Estimator(id=FIRST), MemoryBus(both.broker), MemoryBus(both.broker), Store(":memory:"))
    for _ in range(30):
        both.pass_(0.1)
        double.step(0.0)
    for service in (alone, double):
        assert service.counts.as_dict()[DOUBLE] > 1
    errors = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(errors) == 2
    assert all(f"another estimator says to be {FIRST}" in words for words in errors)
    assert DOUBLE not in both.services[SECOND].counts.as_dict()
