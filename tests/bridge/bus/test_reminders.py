"""What was last is said again, and asked for again (zenoh alone)."""

import time
from typing import Any

import pytest
import zenoh
from zenoh import ext

from bridge.bus.zenoh_bus import ZenohBus
from bridge.bus.zenoh_subscription import Repaired
from tests.bridge.bus.worlds import ZenohWorld, eventually


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
