"""Subscribers in threads and in event loops: slow ones, late ones, over restarts of everything, on both buses."""

import asyncio
import logging
import threading
from collections.abc import Iterator

import pytest

from bridge.bus.contract import Bus, BusError, Publisher
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch
from estimator.client import Client, Miss
from tests.bridge.bus.worlds import MemoryWorld, World, ZenohWorld, eventually
from tests.estimator.client.test_client import numbers
from tests.estimator.client.test_revision import batch

WARD = "w"


@pytest.fixture(params=[MemoryWorld, ZenohWorld])
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    made: World = request.param()
    yield made
    made.stop()


@pytest.fixture
def client(world: World) -> Iterator[Client]:
    with world.bus() as bus:
        yield Client(ward=WARD, bus=bus)


@pytest.fixture
def estimator(world: World) -> Iterator[Bus]:
    with world.bus() as bus:
        yield bus


def publisher(bus: Bus, device: str = "d") -> Publisher:
    return bus.publisher(keys.build(WARD, "corrected", device=device), cache=1000)


def put(publisher: Publisher, *starts: int, device: str = "d", n: int = 5) -> None:
    for start in starts:
        publisher.put(codec.encode_corrected(batch(start, n, device=device)))


def until(stream: Iterator[CorrectedBatch], last: int) -> list[CorrectedBatch]:
    """Batches up to the one that ends with sample `last`."""
    found = []
    for one in stream:
        found.append(one)
        if one.sequence + len(one) > last:
            break
    return found


def test_late_joiners_get_the_past_before_what_is_sent_as_they_join(
    client: Client, world: World, estimator: Bus
) -> None:
    sending = publisher(estimator)
    with world.bus() as bus:
        early = Client(ward=WARD, bus=bus).corrected("d", idle_s=60.0)
        put(sending, *range(0, 200, 5))
        until(iter(early), 199)  # the router knows of the publisher
    going_on = threading.Thread(target=put, args=(sending, *range(200, 2000, 5)))
    going_on.start()
    found = until(iter(client.corrected("d", idle_s=60.0)), 1999)
    going_on.join()
    assert numbers(found) == list(range(2000))


def test_a_router_that_is_gone_for_a_while_costs_nothing(client: Client, world: World, estimator: Bus) -> None:
    sending, stream = publisher(estimator), client.corrected("d", idle_s=60.0)
    put(sending, 0)
    first = stream.receive(60.0)
    assert first is not None
    world.stop()
    # Who has not noticed yet is "connected" all the time, and puts the last message where nobody hears of it.
    eventually(lambda: not client.connected and not estimator.connected)
    put(sending, *range(5, 50, 5))
    world.start()
    eventually(lambda: client.connected and estimator.connected)
    put(sending, 50)
    assert numbers([first, *until(iter(stream), 54)]) == list(range(55))
    assert stream.missing == {}


@pytest.mark.parametrize("devices", ["d", ["d", "other"]])
def test_a_slow_program_loses_the_oldest_and_is_told(
    client: Client, world: World, estimator: Bus, devices: str | list[str], caplog: pytest.LogCaptureFixture
) -> None:
    misses: list[Miss] = []
    slow = client.corrected(devices, queue=10, on_miss=misses.append, idle_s=60.0)
    with world.bus() as bus:
        quick = Client(ward=WARD, bus=bus).corrected("d", idle_s=60.0)
        sending = publisher(estimator)
        put(sending, 0)
        assert slow.receive(60.0) is not None  # then it does something else for long
        for start in range(5, 500, 5):
            put(sending, start)
        assert numbers(until(iter(quick), 499)) == list(range(500)), "nobody else is hurt"
    # Of the 99 that came since it has read; of several devices some wait on their way into one queue.
    eventually(lambda: (89 if devices == "d" else 69) <= slow.dropped <= 89)
    with caplog.at_level(logging.WARNING):
        found = until(iter(slow), 499)
    assert slow.dropped == slow.missed == 99 - len(found)
    assert sum(miss.count for miss in misses) == 5 * slow.dropped == slow.missing["d"]
    assert [record for record in caplog.records if "faster than this program" in record.message]


def test_a_loop_reads_as_a_thread_does(client: Client, estimator: Bus) -> None:
    sending = publisher(estimator)
    put(sending, *range(0, 100, 5))

    async def read() -> list[CorrectedBatch]:
        found = []
        async for one in client.corrected("d", idle_s=30.0):
            found.append(one)
            if one.sequence + len(one) == 100:
                break
        return found

    assert numbers(asyncio.run(read())) == list(range(100))


def test_a_loop_goes_on_while_it_waits_and_a_cancelled_read_loses_nothing(client: Client, estimator: Bus) -> None:
    async def read() -> list[CorrectedBatch]:
        stream = aiter(client.corrected("d"))
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(anext(stream), 0.05)
        put(publisher(estimator), *range(0, 100, 5))
        found: list[CorrectedBatch] = []
        while len(found) < 20:
            try:
                found.append(await asyncio.wait_for(anext(stream), 0.001))
            except TimeoutError:
                continue
        return found

    assert numbers(asyncio.run(asyncio.wait_for(read(), 90.0))) == list(range(100))


@pytest.mark.parametrize("by_client", [False, True])
def test_closing_ends_a_loop_that_waits(world: World, by_client: bool) -> None:
    bus = world.bus()
    stream = Client(ward=WARD, bus=bus).corrected()

    async def read() -> list[CorrectedBatch]:
        asyncio.get_running_loop().call_later(0.05, (bus if by_client else stream).close)
        return [one async for one in stream]

    assert asyncio.run(asyncio.wait_for(read(), 90.0)) == []
    bus.close()


def test_without_a_router_the_error_says_what_to_do() -> None:
    with pytest.raises(
        BusError, match=r"no router answered at tcp/127\.0\.0\.1:1 .*start one with `truerate router --listen tcp"
    ):
        Client(("tcp/127.0.0.1:1",), ward=WARD)
