"""More than an estimator can do: some devices are left out whole, so that the others lose nothing; and come back."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import pytest

from bridge.bus.contract import Message
from bridge.wire.messages import State
from estimator.lifecycle import Event
from estimator.service import overload, shedding
from estimator.service.shedding import CALM_S, FILLED, MOST_CALM_S, PATIENCE_S, SHED, WHY, Shedding
from estimator.under_way import UnderWay
from tests.estimator.served import WARD, Served
from tests.estimator.stream import NAME, calibration

ROOM = 6000


class Queue:
    """A queue of `room`, devices that send ten messages a second each, and a reader that does so many a second."""

    def __init__(self, devices: int, does: float) -> None:
        self.names = [f"d{n}" for n in range(devices)]
        self.does, self.now, self.overflowed = does, 0.0, 0
        self.waits = deque[Message]()
        self.handled, self.lost = Counter[str](), Counter[str]()
        self.shedding = Shedding(ROOM, lambda: self.names[::-1])

    @property
    def shed(self) -> set[str]:
        return {name for name in self.names if name in self.shedding}

    def second(self) -> None:
        spare = 0.0
        for _ in range(10):
            for name in self.names:
                self.waits.append(Message(f"w/raw/b/{name}", b""))
            while len(self.waits) > ROOM:
                self.lost[self.waits.popleft().key] += 1
                self.overflowed += 1
            left = self.does / 10
            while self.waits and left >= 1.0:  # who is left out costs a tenth
                kept = self.shedding.sift([message := self.waits.popleft()])
                self.handled[message.key] += len(kept)
                left -= 1.0 if kept else 0.1
            spare += left if not self.waits else 0.0
        self.now += 1.0
        busy = 1.0 - spare / self.does
        self.shedding.look(self.now, waiting=len(self.waits), overflowed=self.overflowed, busy=busy)

    def run(self, seconds: int) -> None:
        for _ in range(seconds):
            self.second()


@pytest.mark.parametrize("does", [950.0, 700.0, 400.0, 150.0])
def test_those_that_stay_lose_nothing(does: float) -> None:
    queue = Queue(100, does)
    queue.run(100)
    before, overflowed = queue.shed, queue.overflowed
    queue.handled.clear()
    queue.run(300)
    stay = set(queue.names) - before
    assert queue.shed <= before
    assert queue.overflowed == overflowed
    assert all(queue.handled[f"w/raw/b/{name}"] >= 2990 for name in stay)
    # What is left out costs something, too.
    assert 0.7 * does <= 10 * (100 - len(queue.shed)) + len(queue.shed) <= does
    assert before == set(queue.names[-len(before) :]), "the latest"
    assert len(queue.waits) < FILLED * ROOM


@pytest.mark.parametrize("does", [1000.0, 1001.0, 1500.0])
def test_nobody_is_left_out_where_all_can_be_done(does: float) -> None:
    queue = Queue(100, does)
    queue.waits.extend([Message("w/raw/b/d0", b"")] * (ROOM // 2 - 1100))
    for _ in range(300):
        queue.second()
        assert not queue.shed


def test_a_queue_that_becomes_shorter_is_left_to_it() -> None:
    queue = Queue(100, 1100.0)
    queue.waits.extend([Message("w/raw/b/d0", b"")] * (ROOM - 1000))
    for _ in range(300):
        queue.second()
        assert not queue.shed
    assert len(queue.waits) < 1000


def test_they_come_back_when_there_is_room_and_the_first_left_out_come_last() -> None:
    queue = Queue(100, 500.0)
    queue.run(120)
    least = list(queue.shedding._shed)
    assert len(least) > 45
    queue.does = 800.0
    queue.run(120)
    assert queue.shed == set(least[: len(queue.shed)])
    assert 15 <= len(queue.shed) <= 35
    queue.does = 2000.0
    queue.run(60)
    assert not queue.shed
    lost = queue.overflowed
    queue.run(60)
    assert queue.overflowed == lost


def test_where_they_come_back_too_soon_they_wait_longer_and_longer() -> None:
    made, now = Shedding(100, lambda: ["a", "b", "c", "d"]), 0.0
    waits = list[float]()
    for _ in range(9):
        while not made:
            now += 1.0
            made.look(now, waiting=100, overflowed=0, busy=1.0)
        began = now
        while made:
            now += 1.0
            made.look(now, waiting=0, overflowed=0, busy=0.1)
        waits.append(now - began)
    assert waits[0] == pytest.approx(CALM_S, abs=1.5)
    for before, after in pairwise(waits):
        assert after == pytest.approx(min(2 * before, MOST_CALM_S), abs=2.5)


def looked(made: Shedding, begin: float, seconds: int, **how: float) -> float:
    """Looks, a second apart; when the last was."""
    for n in range(1, seconds + 1):
        made.look(begin + n, **{"waiting": 0, "overflowed": 0, "busy": 0.5} | how)  # type: ignore[arg-type]
    return begin + seconds


def names(n: int) -> Callable[[], list[str]]:
    return lambda: [f"d{i}" for i in range(n)]


def test_who_floods_goes_alone_and_stays_away_while_it_does() -> None:
    flooding = {"d7"}
    made = Shedding(100, names(10), lambda some: [name for name in some if name in flooding])
    now = looked(made, 0.0, 6, waiting=100)
    assert list(made) == ["d7"]
    flooding.clear()  # of what is not looked at nobody knows, but for what came
    for _ in range(60):
        made.sift([Message("w/raw/b/d7", b"")] * 500)
        now = looked(made, now, 1, busy=0.1)
        assert list(made) == ["d7"]
    now = looked(made, now, 2 * round(CALM_S), busy=0.1)
    assert not made
    assert made.came("d7") == {"w/raw/b/d7": 30_000}
    assert made.messages == 30_000


def test_a_busy_second_now_and_then_keeps_nobody_away() -> None:
    made = Shedding(100, names(40))
    now = looked(made, 0.0, 6, waiting=100)
    assert len(made) == 4
    for second in range(60):
        now = looked(made, now, 1, busy=0.95 if second % 10 == 5 else 0.2)
    assert not made


def test_where_it_is_just_so_busy_one_is_tried_after_the_other() -> None:
    made = Shedding(100, names(40))
    now = looked(made, 0.0, 6, waiting=100)
    before = len(made)
    now = looked(made, now, round(CALM_S) + 2, busy=0.95)
    assert len(made) == before - 1
    looked(made, now, 300, busy=0.98)
    assert len(made) == before - 1


def test_a_stall_tells_nothing() -> None:
    made = Shedding(100, names(40))
    now = looked(made, 0.0, 2, waiting=60)
    made.look(now + 30.0, waiting=100, overflowed=1000, busy=1.0)
    assert not made
    looked(made, now + 30.0, round(PATIENCE_S) - 1, waiting=100)
    assert not made


def test_while_nothing_can_be_heard_nobody_comes_back() -> None:
    made = Shedding(100, names(40))
    now = looked(made, 0.0, 6, waiting=100)
    for n in range(60):
        made.hold(now + n)
    assert len(made) == 4
    looked(made, now + 60.0, round(CALM_S) - 2, busy=0.0)
    assert len(made) == 4


def test_one_overload_in_several_steps_is_one() -> None:
    made = Shedding(100, names(40))
    now = looked(made, 0.0, 6, waiting=100)
    while made:
        now = looked(made, now, 1, busy=0.1)
    now = looked(made, now, 18, waiting=100)
    assert len(made) > 10
    assert made._calm_s == 2 * CALM_S


def test_one_device_is_never_left_out() -> None:
    made = Shedding(100, lambda: ["a"])
    for now in range(60):
        made.look(float(now), waiting=100, overflowed=100 * now, busy=1.0)
    assert not made
    assert made.sift([Message("w/raw/b/a", b"")])


def test_the_service_says_who_is_left_out_and_why_and_hears_it_again(monkeypatch: pytest.MonkeyPatch) -> None:
    served, batches = Served(), calibration(seed=1).batches()
    twin = [replace(batch, device="twin") for batch in batches]
    with served:
        sent = 0

        def second() -> None:
            nonlocal sent
            for batch in (batches[sent], twin[sent]):
                served.put(batch)
            sent += 1
            served.round(1.0)

        second()
        device, other = served.service._devices[NAME], served.service._devices["twin"]
        monkeypatch.setattr(shedding, "SPARE", 0.6)
        served.raw.waiting = 65536
        for _ in range(round(PATIENCE_S) + 2):
            second()
        assert "twin" in served.service._load._shedding
        assert NAME not in served.service._load._shedding, "it came first"
        taken = other.session.sequence.samples_in
        served.raw.waiting = 0
        for _ in range(5):
            second()
        life = other.session.life
        assert (life.state, life.reason) == (State.UNKNOWN, WHY)
        assert other.session.sequence.samples_in == taken
        assert other.session.sequence.events.as_dict()[SHED] >= 5
        assert served.service.counts.as_dict()[SHED] == other.session.sequence.events.as_dict()[SHED]
        assert device.session.life.state is State.WARMING
        assert device.session.sequence.events.as_dict().get("gaps", 0) == 0
        assert other.latest is not None
        assert device.latest is not None
        [words] = overload.found([device.latest, other.latest])
        assert "1 device is left out" in words
        served.service._load._overload.ratio = 0.1
        monkeypatch.setattr(served.service._load._overload, "look", lambda *_, **__: 0.0)
        for _ in range(2 * round(CALM_S) + 3):
            second()
        assert not served.service._load._shedding
        assert not life.away
        assert other.session.sequence.events.as_dict()["gaps"] == 1
        for _ in range(5):  # and one that falls silent while it is left out is lost
            served.service._load._shedding._shed["twin"] = None
            served.put(batches[sent])
            sent += 1
            served.round(1.0)
        assert life.state is State.LOST
        assert "no samples for" in life.reason


def test_only_who_is_heard_is_left_out_and_who_is_being_calibrated_last() -> None:
    served, batches = Served(), calibration(seed=1).batches()
    with served:
        served.put(replace(batches[0], device="gone"))
        served.round()
        served.round(3.0)
        for name in ("one", "two", "three"):
            served.put(replace(batches[0], device=name))
        served.round()
        assert served.service._load._least() == ["three", "two", "one"]
        session = served.service._devices["three"].session
        session.learnt.under_way = UnderWay(session.knobs, "she", "")
        assert served.service._load._least() == ["two", "one", "three"]


def test_it_is_said_of_a_device_that_was_not_known_before_either_and_another_bridge_speaks_for_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    served, batches = Served(), calibration(seed=1).batches()
    with served:
        served.put(batches[0])
        served.round()
        device = served.service._devices[NAME]
        device.session.silence("the router is gone", Event.UNREACHABLE)
        monkeypatch.setattr(served.service._load._shedding, "look", lambda *_, **__: None)
        served.service._load._shedding._shed[NAME] = None
        served.put(batches[1])
        served.round(1.0)
        served.round(1.0)
        assert device.session.life.reason == WHY
        heard = device.heard
        key = f"truerate/@v1/{WARD}/raw/other/{NAME}"
        for _ in range(4):
            served.raw.messages.append(Message(key, b"whatever"))
            served.round(1.0)
        assert device.heard <= heard + 1.0
        assert device.session.life.state is State.LOST
        del served.service._devices[NAME]
        served.round(1.0)
        assert not served.service._load._shedding
