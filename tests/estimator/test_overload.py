"""An estimator with more devices than it can follow says so, and what to do; it stays ready, and says when it is over."""

import logging

import pytest

from bridge.bus.contract import Message
from bridge.bus.inbox import Inbox
from bridge.wire.messages import State
from estimator import glance
from estimator.device.correct import Cut
from estimator.device.samples import Samples
from estimator.lifecycle import Event
from estimator.outcome import Outcome
from estimator.service import overload
from estimator.service.lost import ASIDE_S
from estimator.service.overload import BUSY, OVER_S, OVERLOADED, PERSISTS_S, Overload
from estimator.service.vitals import Vitals
from estimator.session import DeviceSession
from tests.estimator.served import Before, Served
from tests.estimator.stream import NAME, calibration


def looked(seconds: int, *, idle: float = 0.0, overflowed: int = 0, waited_s: float = 0.0) -> Overload:
    made = Overload(0.0)
    for now in range(1, seconds + 1):
        made.idle(idle)
        made.look(float(now), overflowed=overflowed, waited_s=waited_s)
    return made


@pytest.mark.parametrize(
    ("seconds", "how", "over_s"),
    [
        (4, {}, 0),
        (5, {}, 1),
        (9, {}, 5),
        (60, {"idle": 1.1 - BUSY}, 0),
        (9, {"idle": 0.5, "waited_s": 1.2}, 5),
        (60, {"idle": 0.5, "waited_s": 0.9}, 0),
    ],
)
def test_busy_or_with_messages_that_wait_for_five_seconds(seconds: int, how: dict[str, float], over_s: int) -> None:
    made = looked(seconds, **how)  # type: ignore[arg-type]
    assert made.seconds == over_s
    assert made.ratio == pytest.approx(1.0 - how.get("idle", 0.0))


def test_a_moment_of_leisure_begins_it_anew_and_what_is_dropped_unread_tells_at_once() -> None:
    made = looked(4)
    made.idle(0.3)
    assert made.look(5.0, overflowed=0, waited_s=0.0) == 0
    for now in range(6, 10):
        assert made.look(float(now), overflowed=0, waited_s=0.0) == 0
    made.idle(0.3)
    assert made.look(10.0, overflowed=7, waited_s=0.0) == 1.0
    assert made.seconds == 1


def test_it_is_over_when_it_was_not_so_for_a_while(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    made = looked(20)
    assert made.seconds == 16
    for now in range(21, 21 + round(OVER_S)):
        assert made.seconds
        made.idle(1.0)
        made.look(float(now), overflowed=0, waited_s=0.0)
    assert made.seconds == 0
    for now in range(40, 60):  # again: only counted
        made.look(float(now), overflowed=0, waited_s=0.0)
    assert made.seconds
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 2
    assert "busy 100 %" in said[0]
    assert "fewer devices or a lower rate" in said[0]
    assert "again" in said[1]


class Waiting(Before):
    """Who waits for messages lets time pass."""

    def __init__(self, served: Served) -> None:
        super().__init__()
        self._served = served

    def drain(self, limit: int, timeout_s: float):  # type: ignore[no-untyped-def]
        found = super().drain(limit, timeout_s)
        self._served.now += 0.0 if found else timeout_s
        return found


def test_a_slow_service_says_so_wherever_one_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    served = Served()
    served.raw = Waiting(served)
    handle, batches = DeviceSession.take, calibration(seed=1).batches()

    def slow(self: DeviceSession, samples: Samples, cuts: list[Cut]) -> Outcome | None:
        served.now += 0.4
        return handle(self, samples, cuts)

    with served:
        vitals = Vitals(expects=True, clock=lambda: served.now)
        served.service._stock._vitals = vitals
        monkeypatch.setattr(DeviceSession, "take", slow)

        def busy() -> float:
            [ratio] = [f for f in vitals.families() if f.name == "busy_ratio"]
            return ratio.values[()]

        for at in range(0, 80, 4):
            for batch in batches[at : at + 4]:
                served.put(batch)
            served.service.step(0.05)
        device = served.service._devices[NAME]
        assert device.latest is not None
        assert device.latest.events[OVERLOADED] >= PERSISTS_S
        assert busy() > BUSY
        assert vitals.unready() == []
        seen = glance.glance("w", {NAME: device.latest}, {}, ["bridge"], ["e"])
        assert not seen.well
        assert [words for words in seen.troubles if "has not kept up" in words] == overload.found([device.latest])
        assert served.service.counts.as_dict()[f"{OVERLOADED}, seconds"] > PERSISTS_S
        for _ in range(round((OVER_S + 3) / 0.05)):
            served.service.step(0.05)
        assert OVERLOADED not in device.latest.events
        assert busy() < 0.1


def test_an_inbox_tells_how_long_its_oldest_message_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("bridge.bus.inbox.time.monotonic", lambda: now[0])
    inbox = Inbox(3)
    assert inbox.waited_s == 0
    inbox.put([Message("a", b"1"), Message("a", b"2")])
    now[0] = 2.0
    inbox.put([Message("a", b"3")])
    now[0] = 3.0
    assert inbox.waited_s == 3
    inbox.drain(1, 0.0)
    assert inbox.waited_s == 3
    inbox.drain(1, 0.0)
    assert inbox.waited_s == 1
    inbox.put([Message("a", b"4")] * 3)  # the third makes room
    now[0] = 4.0
    assert inbox.waited_s == 1
    inbox.drain(10, 0.0)
    assert inbox.waited_s == 0


def test_whose_samples_wait_unread_is_not_said_to_be_lost() -> None:
    served, batches = Served(), calibration(seed=1).batches()
    with served:
        served.put(batches[0])
        served.round()
        life = served.service._devices[NAME].session.life
        served.raw.waited_s = 9.5
        for _ in range(10):
            served.round(1.0)
            assert life.state is not State.LOST
        served.raw.waited_s = 0.0
        served.round(1.0)
        assert life.state is State.LOST, "nothing waits any more, and nothing came"


def test_whose_samples_are_set_aside_is_not_said_to_be_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    served, batches = Served(), calibration(seed=1).batches()
    with served:
        served.put(batches[0])
        served.round()
        device = served.service._devices[NAME]

        def lost() -> bool:
            return device.session.life.state is State.LOST

        monkeypatch.setattr(served.service._turns, "_next", lambda: None)  # never their turn
        served.service._turns.slow(device.key, now=True)
        served.put(batches[1])
        for _ in range(round(ASIDE_S) - 1):
            served.round(1.0)
            assert not lost()
        served.round(2.0)
        assert lost(), "it may be what is only said again"
        device.session.life.on(Event.HEARD)
        device.heard = served.now
        served.round(5.0)
        assert not lost()
        served.service._turns.withdraw(NAME)
        served.round(1.0)
        assert lost()
