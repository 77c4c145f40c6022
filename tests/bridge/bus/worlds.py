"""Where buses meet in tests: zenoh through a router in this process, and its twin in memory; and what is waited for there."""

import contextlib
import time
from collections.abc import Callable
from typing import Protocol

from bridge.bus.contract import Bus, BusError, Message, Publisher, Subscription
from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from estimator.demo.ward import free_port
from tests.memory_bus import MemoryBroker, MemoryBus


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
            self._endpoint = f"tcp/127.0.0.1:{free_port()}"
            with contextlib.suppress(BusError):
                self.start()

    def bus(self) -> Bus:
        return ZenohBus([self._endpoint], open_timeout_s=60.0)

    def start(self) -> None:
        self._router = Router([self._endpoint])

    def stop(self) -> None:
        self._router.close()


def eventually(true: Callable[[], bool], timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline, "it never came true"
        time.sleep(0.005)


def meet(publisher: Publisher, subscription: Subscription) -> None:
    """Wait until what is published arrives, and leave nothing behind."""
    arrived = False
    while not arrived:
        publisher.put(b"?")
        arrived = subscription.receive(0.02) is not None
    # A publisher without a cache may lose one while it hears of its first subscriber.
    assert any(_arrives(publisher, subscription) for _ in range(3))


def settled(a: Bus, b: Bus) -> None:
    """Wait until everything that `a` has put so far has passed the router: a session's messages stay in order."""
    publisher, subscription = a.publisher("settled"), b.subscribe("settled")
    meet(publisher, subscription)
    publisher.close()
    subscription.close()


def _arrives(publisher: Publisher, subscription: Subscription) -> bool:
    last = b"%d" % time.monotonic_ns()
    publisher.put(last)
    while (message := subscription.receive(10.0)) is not None:
        if message.payload == last:
            return True
    return False


def numbers(messages: list[Message]) -> list[int]:
    return [int(m.payload) for m in messages]


def collect(subscription: Subscription, count: int, timeout_s: float = 60.0) -> list[Message]:
    """Up to count messages, then whatever else comes within a moment."""
    got: list[Message] = []
    deadline = time.monotonic() + timeout_s
    while len(got) < count and time.monotonic() < deadline:
        got += subscription.drain(1000, 0.2)
    return got + subscription.drain(1000, 0.2)
