"""What is asked of publishers' caches, and what is not: over zenoh, through a router in this process."""

import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence

import pytest
import zenoh

from bridge.bus.contract import Publisher
from bridge.bus.router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.bus.zenoh_session import Channel
from bridge.bus.zenoh_subscription import Repaired


class _Held:
    """Answers that come when they may."""

    def __init__(self, answers: Channel[zenoh.Reply], may: threading.Event) -> None:
        self._answers, self._may = answers, may

    def try_recv(self) -> zenoh.Reply | None:
        return self._answers.try_recv() if self._may.is_set() else None

    def recv(self) -> zenoh.Reply:
        return self._answers.recv()


class Asking(ZenohBus):
    """Notes what caches are asked; they answer when they `may`."""

    def __init__(self, endpoints: Sequence[str]) -> None:
        self.asked: list[tuple[str, str]] = []
        self.may = threading.Event()
        super().__init__(endpoints)

    def past(self, selector: str, what: str = "") -> Channel[zenoh.Reply]:  # type: ignore[override]
        self.asked.append((selector, what))
        return _Held(super().past(selector, what), self.may)


class Stopped(Repaired):
    """Reads nothing while it may not."""

    may: threading.Event

    def _take(self, samples: Sequence[zenoh.Sample]) -> None:
        self.may.wait()
        super()._take(samples)


@pytest.fixture
def endpoint() -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        at = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with Router([at]):
        yield at


def say_the_last(bus: ZenohBus, publisher: Publisher) -> None:
    """As zenoh does by itself, every quarter of a second."""
    publisher.remind(bus._session)  # type: ignore[attr-defined]


def said_the_last(bus: ZenohBus, publisher: Publisher, to: Repaired) -> bool:
    say_the_last(bus, publisher)
    return bool(to._sequences._lacking)


def eventually(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10.0
    while not true():
        assert time.monotonic() < deadline, "it never came true"
        time.sleep(0.002)


def test_who_asked_for_some_of_the_past_is_not_given_all_of_it_for_news_of_what_was_last(
    endpoint: str,
) -> None:
    with ZenohBus([endpoint]) as a, Asking([endpoint]) as b:
        publisher = a.publisher("t/some", cache=50)
        for number in range(50):
            publisher.put(b"%d" % number)
        time.sleep(0.5)
        subscription = b.subscribe("t/*", history=True, most_past=7)
        assert isinstance(subscription, Repaired)
        eventually(lambda: said_the_last(a, publisher, subscription))
        time.sleep(0.2)
        assert b.asked == [("t/*/@adv/**", "_max=7")], "the past is under way: nothing is known to be missing"
        b.may.set()
        came = [subscription.receive(5.0) for _ in range(7)]
        publisher.put(b"50")
        came.append(subscription.receive(5.0))
        assert [int(message.payload) for message in came if message] == list(range(43, 51))
        assert (len(b.asked), subscription.missed) == (1, 0)


@pytest.mark.parametrize(("early", "what"), [(True, "_max=7"), (False, "")])
def test_of_who_came_later_all_of_the_past_comes_for_nobody_else_has_done_it(
    endpoint: str, early: bool, what: str
) -> None:
    with ZenohBus([endpoint]) as a, Asking([endpoint]) as b:
        subscription = b.subscribe("t/*", history=True, most_past=7)
        assert isinstance(subscription, Repaired)
        if not early:
            b.may.set()
            eventually(lambda: subscription.caught_up)
        time.sleep(0.2)
        a._session.put("t/other/@adv/pub/abd/1/_", b"\7\0\0\0")
        eventually(lambda: bool(subscription._sequences._lacking))
        b.may.set()
        eventually(lambda: len(b.asked) > 1)
        assert b.asked[1] == ("t/other/@adv/pub/abd/1/**", what)


@pytest.mark.parametrize(("held_s", "asked"), [(0.4, 0), (1.6, 1)])
def test_what_waits_here_unread_is_not_asked_for_again_for_a_while(
    endpoint: str, held_s: float, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.bus.zenoh_bus.Repaired", Stopped)
    monkeypatch.setattr(Stopped, "may", threading.Event(), raising=False)
    with ZenohBus([endpoint]) as a, Asking([endpoint]) as b:
        b.may.set()
        publisher, subscription = a.publisher("t/busy", cache=50), b.subscribe("t/*", history=True)
        assert isinstance(subscription, Stopped)
        eventually(lambda: subscription.caught_up)
        time.sleep(0.2)
        for number in range(5):
            publisher.put(b"%d" % number)
        eventually(lambda: not subscription._empty)
        deadline = time.monotonic() + held_s
        while time.monotonic() < deadline:
            say_the_last(a, publisher)
            time.sleep(0.05)
        assert min(len(b.asked) - 1, 1) == asked
        assert bool(subscription._sequences._lacking) == (not asked), "it was said what was last"
        Stopped.may.set()
        came = [subscription.receive(5.0) for _ in range(5)]
        assert [int(message.payload) for message in came if message] == list(range(5))


def test_a_question_that_never_ends_keeps_nothing_waiting_for_ever(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.bus.zenoh_subscription._OVER_S", 0.3)
    with ZenohBus([endpoint]) as a, Asking([endpoint]) as b:
        publisher, subscription = a.publisher("t/some", cache=50), b.subscribe("t/*", history=True)
        assert isinstance(subscription, Repaired)
        eventually(lambda: subscription.caught_up)
        time.sleep(0.2)
        publisher.put(b"0")
        assert (first := subscription.receive(5.0)) is not None
        assert first.payload == b"0"
        with monkeypatch.context() as deaf:
            lost = list[object]()
            deaf.setattr(subscription, "_take", lost.extend)
            publisher.put(b"1")
            eventually(lambda: bool(lost))
        publisher.put(b"2")
        eventually(lambda: len(b.asked) > 2)
        b.may.set()
        assert [one.payload for _ in range(2) if (one := subscription.receive(5.0))] == [b"1", b"2"]
        assert subscription.missed == 0
