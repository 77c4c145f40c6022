"""The contract of a bus, held by both: zenoh through a router in this process, and its twin in memory."""

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import pytest
import zenoh
from zenoh import ext

from bridge.bus.contract import Bus, BusError, Declared, Message, Publisher, Subscription
from bridge.bus.keyexpr import matches
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.bus.router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.bus.zenoh_subscription import Repaired


class World(Protocol):
    """A place where buses meet, and which can be taken away."""

    def bus(self) -> Bus: ...
    def stop(self) -> None: ...
    def start(self) -> None: ...


class MemoryWorld:
    def __init__(self) -> None:
        self._broker = MemoryBroker()
        self.stop, self.start = self._broker.stop, self._broker.start

    def bus(self) -> Bus:
        return MemoryBus(self._broker)


class ZenohWorld:
    def __init__(self) -> None:
        while not hasattr(self, "_router"):  # another test process may take the free port first
            with socket.create_server(("127.0.0.1", 0)) as probe:
                self._endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
            with contextlib.suppress(BusError):
                self.start()

    def bus(self) -> Bus:
        return ZenohBus([self._endpoint])

    def start(self) -> None:
        self._router = Router([self._endpoint])

    def stop(self) -> None:
        self._router.close()


@pytest.fixture(params=[MemoryWorld, ZenohWorld])
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    made: World = request.param()
    yield made
    made.stop()


@pytest.fixture
def a(world: World) -> Iterator[Bus]:
    with world.bus() as bus:
        yield bus


@pytest.fixture
def b(world: World) -> Iterator[Bus]:
    with world.bus() as bus:
        yield bus


def eventually(true: Callable[[], bool], timeout_s: float = 10.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline, "it never came true"
        time.sleep(0.005)


def meet(publisher: Publisher, subscription: Subscription) -> None:
    """Wait until what is published arrives, and leave nothing behind."""
    last = b"%d" % time.monotonic_ns()
    arrived = False
    while not arrived:
        publisher.put(b"?")
        arrived = subscription.receive(0.02) is not None
    publisher.put(last)
    while (message := subscription.receive(5.0)) is None or message.payload != last:
        assert message is not None


def numbers(messages: list[Message]) -> list[int]:
    return [int(m.payload) for m in messages]


def collect(subscription: Subscription, count: int, timeout_s: float = 20.0) -> list[Message]:
    """Up to count messages, then whatever else comes within a moment."""
    got: list[Message] = []
    deadline = time.monotonic() + timeout_s
    while len(got) < count and time.monotonic() < deadline:
        got += subscription.drain(1000, 0.2)
    return got + subscription.drain(1000, 0.2)


def test_messages_arrive_in_order_and_once(a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/order"), b.subscribe("t/order")
    meet(publisher, subscription)
    for n in range(2000):
        publisher.put(b"%d" % n)
    assert numbers(collect(subscription, 2000)) == list(range(2000))
    assert subscription.missed == 0


def test_who_joins_busy_publishers_has_their_past(world: World, a: Bus) -> None:
    publishers = [a.publisher(f"t/busy/{n}", cache=1000) for n in range(20)]
    with world.bus() as early:
        subscription = early.subscribe("t/busy/*", history=True)
        for n in range(50):
            for publisher in publishers:
                publisher.put(b"%d" % n)
        assert len(collect(subscription, 1000)) == 1000
    stop, sent = threading.Event(), [50]

    def go_on() -> None:
        while not stop.is_set() and sent[0] < 900:
            for publisher in publishers:
                publisher.put(b"%d" % sent[0])
            sent[0] += 1
            time.sleep(0.001)

    busy = threading.Thread(target=go_on)
    busy.start()
    try:
        for _ in range(5):
            with world.bus() as late:
                subscription = late.subscribe("t/busy/*", history=True)
                got: dict[str, list[int]] = {}
                while len(got) < len(publishers) or min(map(len, got.values())) < 60:
                    for key, payload in subscription.drain(1000, 1.0):
                        got.setdefault(key, []).append(int(payload))
                assert [found for found in got.values() if found != list(range(len(found)))] == []
                assert subscription.missed == 0
    finally:
        stop.set()
        busy.join()


def test_a_bus_hears_itself(a: Bus) -> None:
    subscription = a.subscribe("t/**")
    a.publisher("t/self").put(b"1")
    assert subscription.receive(2.0) == ("t/self", b"1")


def test_a_pattern_takes_its_own_keys_only(a: Bus, b: Bus) -> None:
    subscription = b.subscribe("t/*/x", history=True)
    meet(a.publisher("t/0/x"), subscription)
    for key in ("t/1/x", "t/@2/x", "t/1/y", "t/x", "t/1/2/x", "t/3/x"):
        a.publisher(key, cache=1).put(key.encode())
    assert sorted(collect(subscription, 2)) == [("t/1/x", b"t/1/x"), ("t/3/x", b"t/3/x")]


@pytest.mark.parametrize(
    ("pattern", "key", "expected"),
    [
        ("a/**", "a", True),
        ("a/**", "a/b/c", True),
        ("a/**", "a/@b", False),
        ("**", "@a", False),
        ("*", "@a", False),
        ("**/b", "a/@x/b", False),
        ("a/**/@b", "a/c/@b", True),
        ("a/@b/**", "a/@b", True),
        ("a/**/c", "a/c", True),
        ("a/*", "a", False),
        ("a/b", "a/b/c", False),
    ],
)
def test_patterns_mean_what_they_mean_to_zenoh(pattern: str, key: str, expected: bool) -> None:
    assert matches(pattern, key) is expected
    with MemoryBus(MemoryBroker()) as bus:
        subscription = bus.subscribe(pattern)
        bus.publisher(key).put(b"1")
        assert (subscription.receive(0) is not None) is expected


@pytest.mark.parametrize(
    "key", ["", "/a", "a/", "a//b", "a/*", "**", "a/$*", "a b", "a\n", "a\0", "a?b", "a#", "\ud800", "é"]
)
def test_a_hostile_key_is_refused_and_harms_nothing(a: Bus, key: str) -> None:
    for declare in (a.publisher, a.declare_alive, lambda k: a.ask(k, b"", 0.1)):
        with pytest.raises(BusError):
            declare(key)
    subscription = a.subscribe("t/ok")
    a.publisher("t/ok").put(b"1")
    assert subscription.receive(2.0) is not None


@pytest.mark.parametrize("pattern", ["", "a//b", "a*", "a/**/**", "a/**/*", "***", "$*", "a" * 201])
def test_a_hostile_pattern_is_refused(a: Bus, pattern: str) -> None:
    with pytest.raises(BusError):
        a.subscribe(pattern)
    with pytest.raises(BusError):
        a.watch_alive(pattern, lambda key, alive: None)
    with pytest.raises(BusError):
        a.answer(pattern, lambda key, payload: payload)


@pytest.mark.parametrize("length", [201, 70_000])
def test_a_key_too_long_leaves_the_bus_usable(a: Bus, b: Bus, length: int) -> None:
    publisher, subscription = a.publisher("t/before"), b.subscribe("t/before")
    with pytest.raises(BusError, match=f"{length} characters"):
        a.publisher("k" * length)
    meet(publisher, subscription)


def test_a_late_joiner_gets_history_then_live(a: Bus, b: Bus) -> None:
    publisher = a.publisher("t/late", cache=100)
    for n in range(150):
        publisher.put(b"%d" % n)
    time.sleep(0.1)  # what is still on its way to the router would come as live
    subscription = b.subscribe("t/*", history=True)
    assert numbers(collect(subscription, 100)) == list(range(50, 150))
    for n in range(150, 160):
        publisher.put(b"%d" % n)
    assert numbers(collect(subscription, 10)) == list(range(150, 160))
    assert subscription.missed == 0


def test_a_bus_with_more_history_of_its_own_than_a_channel_holds_does_not_hang(a: Bus) -> None:
    publisher = a.publisher("t/own", cache=70_000)
    for n in range(70_000):
        publisher.put(b"%d" % n)
    subscription = a.subscribe("t/own", history=True, capacity=100_000)
    assert numbers(collect(subscription, 70_000)) == list(range(70_000))


def test_who_does_not_answer_is_asked_again_though_nothing_else_is_heard() -> None:
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(a, ZenohBus)
        subscription = b.subscribe("t/quiet", history=True)
        assert isinstance(subscription, Repaired)
        # Of a publisher that is gone: the last that was heard of it.
        told = ext.z_serialize(ext.UInt32(3))
        eventually(lambda: _told(a, told, subscription))
        (lacking,) = subscription._sequences._lacking.values()
        eventually(lambda: lacking.tries >= 4)
    world.stop()


def test_what_was_last_is_said_again_for_who_did_not_hear_it() -> None:
    """As of a device that went to another estimator, or of a calibration, while the line between two routers was cut."""
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(b, ZenohBus)
        numbers: list[int] = []
        beats = b._session.declare_subscriber(
            "t/last/@adv/pub/**", lambda sample: numbers.append(ext.z_deserialize(ext.UInt32, sample.payload))
        )
        publisher = a.publisher("t/last", cache=3)
        time.sleep(0.2)
        publisher.put(b"0")
        publisher.put(b"1")
        eventually(lambda: len(numbers) >= 3)
        assert set(numbers) <= {0, 1}
        assert numbers[-2:] == [1, 1]
        beats.undeclare()  # type: ignore[no-untyped-call]
    world.stop()


class Leaving:
    """A publisher of zenoh's that is being taken back on another thread."""

    @property
    def id(self) -> None:
        raise RuntimeError("Already mutably borrowed")


def test_a_reminder_asks_nothing_of_a_publisher_that_is_leaving() -> None:
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(a, ZenohBus)
        publisher, subscription = a.publisher("t/leaving", cache=3), b.subscribe("t/leaving", history=True)
        publisher.put(b"0")
        assert subscription.receive(2.0) is not None
        kept, publisher._publisher = publisher._publisher, Leaving()  # type: ignore[assignment]
        publisher.remind(a._session)
        publisher._publisher = kept
        publisher.close()
        publisher.remind(a._session)
    world.stop()


class _Hasty(set[object]):
    """Things declared, reminded as soon as they are known, as a thread of the bus may do."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus

    def add(self, one: Any) -> None:
        super().add(one)
        one.remind(self._bus._session)


def test_a_publisher_may_be_reminded_as_soon_as_the_bus_knows_it() -> None:
    world = ZenohWorld()
    with world.bus() as a:
        assert isinstance(a, ZenohBus)
        a.declared = _Hasty(a)  # type: ignore[assignment]
        a.publisher("t/new", cache=3).put(b"0")
        assert len(a.declared) == 1
    world.stop()


def _told(bus: ZenohBus, told: zenoh.ZBytes, subscription: Repaired) -> bool:
    if not subscription._sequences._lacking:
        bus._session.put("t/quiet/@adv/pub/abc/1/_", told)
    return bool(subscription._sequences._lacking)


@pytest.mark.parametrize("said", [b"", b"\1", b"\1\0\0\0\0", b"\xff" * 3000])
def test_hostile_heartbeats_are_no_news(said: bytes) -> None:
    world = ZenohWorld()
    with world.bus() as a, world.bus() as b:
        assert isinstance(a, ZenohBus)
        subscription = b.subscribe("t/quiet", history=True)
        assert isinstance(subscription, Repaired)
        time.sleep(0.2)
        a._session.put("t/quiet/@adv/pub/abc/1/_", said)
        a._session.put("t/quiet/@adv/pub/abd/1/_", b"\0\0\0\0")
        eventually(lambda: bool(subscription._sequences._sources))
        assert list(subscription._sequences._sources) == ["t/quiet/@adv/pub/abd/1"]
    world.stop()


def test_without_history_nothing_old_comes(a: Bus, b: Bus) -> None:
    a.publisher("t/old", cache=10).put(b"1")
    time.sleep(0.1)
    assert b.subscribe("t/old").receive(0.2) is None


def test_a_publisher_knows_whether_it_is_wanted(a: Bus, b: Bus) -> None:
    plain = a.publisher("truerate/@v1/w/@windowed/d1")
    assert not plain.wanted
    assert a.publisher("truerate/@v1/w/status/d1", cache=1).wanted
    everything = b.subscribe("truerate/@v1/w/**")
    other = b.subscribe("truerate/@v1/w/@windowed/d2")
    for pattern in ("truerate/@v1/w/@windowed/*", "truerate/@v1/w/@windowed/d1"):
        asked = b.subscribe(pattern)
        eventually(lambda: plain.wanted)
        asked.close()
        eventually(lambda: not plain.wanted)
    for one in (everything, other):
        one.close()
    plain.close()


def test_a_full_queue_drops_its_oldest_and_counts_it(a: Bus, b: Bus) -> None:
    publisher, slow, quick = a.publisher("t/full"), b.subscribe("t/full", capacity=10), b.subscribe("t/full")
    meet(publisher, slow)
    meet(publisher, quick)
    while slow.drain(100, 0.2):
        pass
    missed = slow.missed
    for n in range(1000):
        publisher.put(b"%d" % n)
    assert numbers(collect(quick, 1000)) == list(range(1000))
    eventually(lambda: slow.missed - missed == 990)
    assert slow.missed_by_key == {"t/full": slow.missed}
    assert numbers(slow.drain(100, 1.0)) == list(range(990, 1000))


def test_a_past_that_a_queue_has_no_room_for_comes_whole(a: Bus, b: Bus) -> None:
    publishers = [a.publisher(f"t/past/{n}", cache=50) for n in range(2)]
    for number in range(50):
        for publisher in publishers:
            publisher.put(str(number).encode())
    time.sleep(0.5)  # what is still under way would come as news
    subscription = b.subscribe("t/past/*", history=True, capacity=10)
    time.sleep(0.5)  # all of it is there before any is read
    past = collect(subscription, 100)
    assert [numbers([m for m in past if m.key.endswith(str(n))]) for n in range(2)] == [list(range(50))] * 2
    assert subscription.missed == 0
    for number in range(50, 100):
        publishers[0].put(str(number).encode())
    eventually(lambda: subscription.missed == 40)
    assert numbers(subscription.drain(100, 0.0)) == list(range(90, 100)), "its own length counts again"
    subscription.close()
    short = b.subscribe("t/past/0", history=True, capacity=10, all_past=False)
    eventually(lambda: short.missed == 40)
    assert numbers(collect(short, 10)) == list(range(90, 100)), "the newest of it"
    short.close()


def test_where_there_is_no_room_for_the_past_of_all_each_has_its_latest(a: Bus, b: Bus) -> None:
    """The last to be asked had all of it, the first nothing: where an estimator took those over, what it had not was lost."""
    publishers = [a.publisher(f"t/many/{n}", cache=50) for n in range(10)]
    for number in range(50):
        for publisher in publishers:
            publisher.put(str(number).encode())
    time.sleep(0.5)  # what is still under way would come as news
    subscription = b.subscribe("t/many/*", history=True, capacity=200, all_past=False)
    eventually(lambda: subscription.missed == 300)
    came = subscription.drain(500, 1.0)
    assert [numbers([m for m in came if m.key.endswith(str(n))]) for n in range(10)] == [list(range(30, 50))] * 10


def test_of_the_past_as_much_comes_as_is_asked_for_and_all_that_follows(a: Bus, b: Bus) -> None:
    publishers = [a.publisher(f"t/some/{n}", cache=50) for n in range(2)]
    for number in range(50):
        for publisher in publishers:
            publisher.put(str(number).encode())
    time.sleep(0.5)  # what is still under way would come as news
    subscription = b.subscribe("t/some/*", history=True, most_past=7)
    came = collect(subscription, 14)
    for publisher in publishers:
        publisher.put(b"50")
    came += collect(subscription, 2)
    assert [numbers([m for m in came if m.key.endswith(str(n))]) for n in range(2)] == [list(range(43, 51))] * 2
    assert subscription.missed == 0


def test_of_who_was_out_of_reach_more_comes_than_was_asked_for_of_the_past(world: World) -> None:
    with world.bus() as a, world.bus() as b:
        subscription = b.subscribe("t/some/*", history=True, most_past=7)
        eventually(lambda: subscription.caught_up)
        world.stop()
        publisher = a.publisher("t/some/0", cache=50)
        for number in range(20):
            publisher.put(str(number).encode())
        world.start()
        assert numbers(collect(subscription, 20)) == list(range(20))


def test_waiting_keeps_to_its_timeout(a: Bus) -> None:
    subscription = a.subscribe("t/none")
    for wait in (lambda: subscription.receive(0.2), lambda: subscription.drain(5, 0.2)):
        busy, began = time.thread_time(), time.monotonic()
        assert not wait()
        assert 0.15 < time.monotonic() - began < 10.0
        assert time.thread_time() - busy < 0.05
    assert subscription.receive(0) is None
    assert subscription.receive(-1) is None


def test_drain_takes_no_more_than_its_limit(a: Bus) -> None:
    publisher, subscription = a.publisher("t/limit", cache=10), a.subscribe("t/limit")
    meet(publisher, subscription)
    for n in range(10):
        publisher.put(b"%d" % n)
    got = subscription.drain(4, 2.0)
    assert 1 <= len(got) <= 4
    assert numbers(got + collect(subscription, 10 - len(got))) == list(range(10))


def test_an_outage_loses_nothing_that_is_cached(world: World, a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/outage", cache=1000), b.subscribe("t/outage", history=True)
    meet(publisher, subscription)
    for n in range(100):
        publisher.put(b"%d" % n)
    first = collect(subscription, 100)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    for n in range(100, 200):
        publisher.put(b"%d" % n)
    world.start()
    eventually(lambda: a.connected and b.connected)
    for n in range(200, 300):
        publisher.put(b"%d" % n)
    assert numbers(first + collect(subscription, 200)) == list(range(300))
    assert subscription.missed == 0


@pytest.mark.parametrize("key", ["t/last", "t/@v1/last"])  # zenoh itself cannot repair the second
@pytest.mark.parametrize("later_s", [0.0, 0.6])
def test_the_last_message_of_an_outage_arrives_though_nothing_follows(
    world: World, a: Bus, b: Bus, key: str, later_s: float
) -> None:
    publisher, subscription = a.publisher(key, cache=10), b.subscribe(key, history=True)
    meet(publisher, subscription)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    publisher.put(b"2")
    time.sleep(later_s)
    world.start()
    assert numbers(collect(subscription, 1)) == [2]


def test_what_is_put_as_the_router_comes_back_arrives_though_nothing_follows(world: World, a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/@v1/last", cache=10), b.subscribe("t/@v1/*", history=True)
    meet(publisher, subscription)
    for n in range(2, 12, 2):
        world.stop()
        eventually(lambda: not (a.connected or b.connected))
        publisher.put(b"%d" % n)
        world.start()
        eventually(lambda: a.connected and b.connected)
        publisher.put(b"%d" % (n + 1))  # who listens is not known yet
        assert numbers(collect(subscription, 2)) == [n, n + 1]
    assert subscription.missed == 0


def test_what_an_outage_took_for_good_is_counted(world: World, a: Bus, b: Bus) -> None:
    publisher, subscription = a.publisher("t/lost", cache=10), b.subscribe("t/lost", history=True)
    meet(publisher, subscription)
    world.stop()
    eventually(lambda: not (a.connected or b.connected))
    for n in range(1, 101):
        publisher.put(b"%d" % n)
    world.start()
    assert numbers(collect(subscription, 10)) == list(range(91, 101))
    eventually(lambda: subscription.missed == 90)
    assert subscription.missed_by_key == {"t/lost": 90}


def test_an_answer_comes_back(a: Bus, b: Bus) -> None:
    b.answer("q/*/double", lambda key, payload: key.encode() + payload * 2)
    eventually(lambda: answered(a, "q/x/double"))
    assert a.ask("q/x/double", b"ab") == b"q/x/doubleabab"


def answered(bus: Bus, key: str) -> bool:
    try:
        return bool(bus.ask(key, b"", 0.5))
    except BusError as error:
        return "answered with an error" in str(error)


def test_of_all_who_answer_the_one_who_has_something_to_say_is_heard(world: World, a: Bus, b: Bus) -> None:
    asked: list[str] = []

    def of(name: str, says: bytes) -> Callable[[str, bytes], bytes]:
        def handler(key: str, payload: bytes) -> bytes:
            asked.append(name)
            return says + payload if says else b""

        return handler

    c = world.bus()
    with c:
        held = [b.answer("t/*", of("first", b"")), c.answer("t/*", of("second", b"mine: "))]
        eventually(lambda: answered(a, "t/x") and {*asked} == {"first", "second"})
        assert a.ask("t/x", b"hello") == b"mine: hello"
        held[1].close()
        with pytest.raises(BusError, match="empty answer"):
            a.ask("t/x", b"hello")


def test_asking_nobody_fails_at_once(a: Bus) -> None:
    began = time.monotonic()
    with pytest.raises(BusError, match="nobody answers 'q/none'"):
        a.ask("q/none", b"", 5.0)
    assert time.monotonic() - began < 2.0


def test_an_answer_too_late_or_empty_is_a_failure(a: Bus, b: Bus) -> None:
    done = threading.Event()
    b.answer("q/slow", lambda key, payload: b"late" if done.wait(5.0) else b"")
    b.answer("q/empty", lambda key, payload: b"")
    eventually(lambda: answered(a, "q/empty"))
    with pytest.raises(BusError):
        a.ask("q/empty", b"")
    began = time.monotonic()
    with pytest.raises(BusError):
        a.ask("q/slow", b"", 0.3)
    assert time.monotonic() - began < 2.0
    done.set()


def test_a_handler_that_raises_is_heard_of_on_both_sides(a: Bus, b: Bus, caplog: pytest.LogCaptureFixture) -> None:
    def handler(key: str, payload: bytes) -> bytes:
        if payload == b"good":
            return b"fine"
        raise ValueError("out of turns")

    caplog.set_level(logging.DEBUG)
    b.answer("q/bad", handler)
    eventually(lambda: answered(a, "q/bad"))
    with pytest.raises(BusError, match="ValueError: out of turns"):
        a.ask("q/bad", b"")
    assert a.ask("q/bad", b"good") == b"fine"
    levels = [r.levelname for r in caplog.records if r.name == "bridge.bus.handlers"]
    assert levels.count("ERROR") == 1
    assert levels.count("DEBUG") >= 1
    assert levels[-1] == "INFO"


class Watched:
    """What a watcher was told."""

    def __init__(self, bus: Bus, pattern: str) -> None:
        self.changes: list[tuple[str, bool]] = []
        self.declared = bus.watch_alive(pattern, lambda key, alive: self.changes.append((key, alive)))


def test_liveliness_is_seen_by_early_and_late_watchers(world: World, a: Bus, b: Bus) -> None:
    early = Watched(b, "alive/**")
    token = a.declare_alive("alive/x")
    a.declare_alive("other/x")
    eventually(lambda: early.changes == [("alive/x", True)])
    late = Watched(b, "alive/*")
    eventually(lambda: late.changes == [("alive/x", True)])
    time.sleep(0.1)  # see ZenohBus.watch_alive for a token that dies while a watcher joins
    token.close()
    token.close()
    for watched in (early, late):
        eventually(lambda w=watched: w.changes == [("alive/x", True), ("alive/x", False)])  # type: ignore[misc]


def test_a_closed_bus_takes_its_tokens_with_it(world: World, b: Bus) -> None:
    watched = Watched(b, "alive/*")
    with world.bus() as gone:
        gone.declare_alive("alive/y")
        eventually(lambda: watched.changes == [("alive/y", True)])
    eventually(lambda: watched.changes == [("alive/y", True), ("alive/y", False)])


def test_tokens_go_and_come_with_the_connection(world: World, a: Bus, b: Bus) -> None:
    watched = Watched(b, "alive/*")
    a.declare_alive("alive/z")
    eventually(lambda: len(watched.changes) == 1)
    world.stop()
    eventually(lambda: len(watched.changes) == 2)
    world.start()
    eventually(lambda: watched.changes == [("alive/z", alive) for alive in (True, False, True)])


def test_a_watcher_that_raises_keeps_watching(a: Bus, b: Bus) -> None:
    seen: list[str] = []

    def on_change(key: str, alive: bool) -> None:
        seen.append(key)
        raise RuntimeError("not today")

    b.watch_alive("alive/*", on_change)
    for n in range(3):
        a.declare_alive(f"alive/{n}")
    eventually(lambda: sorted(seen) == ["alive/0", "alive/1", "alive/2"])


def test_closing_twice_is_closing_once(world: World) -> None:
    bus = world.bus()
    declared: list[Declared] = [
        bus.publisher("t/c", cache=5),
        bus.subscribe("t/c", history=True),
        bus.subscribe("t/c"),
        bus.answer("q/c", lambda key, payload: payload),
        bus.declare_alive("alive/c"),
        bus.watch_alive("alive/c", lambda key, alive: None),
    ]
    for one in declared:
        one.close()
        one.close()
    bus.close()
    bus.close()
    for one in declared:
        one.close()


def test_a_closed_bus_says_so(world: World) -> None:
    bus = world.bus()
    publisher, subscription = bus.publisher("t/x"), bus.subscribe("t/x")
    before = bus.connected
    bus.close()
    assert (before, bus.connected) == (True, False)
    assert subscription.receive(5.0) is None
    assert subscription.drain(5, 5.0) == []
    for use in (
        lambda: publisher.put(b""),
        lambda: bus.publisher("t/y"),
        lambda: bus.subscribe("t/y", history=True),
        lambda: bus.ask("t/y", b""),
        lambda: bus.answer("t/y", lambda key, payload: payload),
        lambda: bus.declare_alive("t/y"),
        lambda: bus.watch_alive("t/y", lambda key, alive: None),
    ):
        with pytest.raises(BusError):
            use()


@pytest.mark.parametrize("history", [False, True])
def test_a_subscription_says_when_nothing_will_come_again(world: World, history: bool) -> None:
    with world.bus() as bus:
        own, of_the_bus = (bus.subscribe("t/end", history=history) for _ in range(2))
        assert (own.closed, of_the_bus.closed) == (False, False)
        assert own.receive(0) is None
        own.close()
        assert (own.closed, of_the_bus.closed) == (True, False)
    assert of_the_bus.closed


def test_an_outage_does_not_close_a_subscription(world: World, a: Bus) -> None:
    subscription = a.subscribe("t/open")
    world.stop()
    eventually(lambda: not a.connected)
    assert not subscription.closed
    world.start()
    assert not subscription.closed


def test_a_reader_waiting_is_woken_once_and_misses_nothing(a: Bus) -> None:
    publisher, subscription = a.publisher("t/woken"), a.subscribe("t/woken")
    meet(publisher, subscription)
    began = time.monotonic()
    threading.Timer(0.1, subscription.wake).start()
    assert not subscription.drain(5, 20.0)
    subscription.wake()  # before it waits
    assert not subscription.drain(5, 20.0)
    assert time.monotonic() - began < 10.0
    publisher.put(b"7")
    assert numbers(subscription.drain(5, 20.0)) == [7]


def test_a_reader_waiting_is_woken_by_close(a: Bus) -> None:
    subscription = a.subscribe("t/wait")
    threading.Timer(0.1, subscription.close).start()
    began = time.monotonic()
    assert subscription.receive(10.0) is None
    assert time.monotonic() - began < 5.0
    publisher = a.publisher("t/gone")
    publisher.close()
    with pytest.raises(BusError, match="closed"):
        publisher.put(b"")


@pytest.mark.parametrize("cache", [0, 5000])
def test_several_threads_may_publish_at_once(a: Bus, b: Bus, cache: int) -> None:
    publisher, subscription = a.publisher("t/threads", cache=cache), b.subscribe("t/threads", history=bool(cache))
    meet(publisher, subscription)

    def run(of: int) -> None:
        for n in range(500):
            publisher.put(b"%d" % (of * 1000 + n))

    threads = [threading.Thread(target=run, args=(of,)) for of in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    got = numbers(collect(subscription, 2000))
    assert len(got) == 2000
    for of in range(4):
        assert [n % 1000 for n in got if n // 1000 == of] == list(range(500))
