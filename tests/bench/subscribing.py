"""Costs of a subscriber: processor time a batch, by `for` and by `async for`; its threads; many publishers on a real router.

`make bench`.
"""

import asyncio
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
from rich.console import Console

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.bus.router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.client import Client
from estimator.demo.ward import free_port
from tests.estimator.client.test_revision import batch

WARD, DEVICES, BATCHES, SAMPLES = "w", 100, 600, 5


def in_order() -> list[tuple[str, bytes]]:
    """Half a minute of a hundred devices, twenty batches a second, as they come."""
    found = []
    for n in range(BATCHES):
        for device in range(DEVICES):
            one = batch(n * SAMPLES, SAMPLES, device=f"d{device}")
            found.append((one.device, codec.encode_corrected(one)))
    return found


def mixed_up() -> list[tuple[str, bytes]]:
    """The same of a network that loses one batch in a hundred, repeats one in ten, and delivers each up to ten late."""
    rng, sent = np.random.default_rng(1), in_order()
    times = rng.choice([0, 1, 2], len(sent), p=[0.01, 0.89, 0.1])
    came = [(n + DEVICES * rng.uniform(0, 10), n) for n, copies in enumerate(times) for _ in range(copies)]
    return [sent[n] for _, n in sorted(came)]


def thread(client: Client, fill: Callable[[], None]) -> int:
    """Batches read by `for`."""
    stream = client.corrected(idle_s=0.2, queue=10**6)
    fill()
    return sum(1 for _ in stream)


def loop(client: Client, fill: Callable[[], None]) -> int:
    """Batches read by `async for`."""

    async def read() -> int:
        stream = client.corrected(idle_s=0.2, queue=10**6)
        fill()
        return len([1 async for _ in stream])

    return asyncio.run(read())


def many_publishers(publishers: int = 1000, rounds: int = 20) -> float:
    """CPU seconds a message of publisher, router and subscriber together, all in this process."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router([endpoint]), ZenohBus([endpoint]) as a, ZenohBus([endpoint]) as b:
        subscription = b.subscribe("t/*", history=True)
        made = [a.publisher(f"t/{n}", cache=20) for n in range(publishers)]

        def put_and_get(rounds: int) -> None:
            for _ in range(rounds):
                for publisher in made:
                    publisher.put(b"")
            left = rounds * publishers
            while left and (new := len(subscription.drain(10_000, 5.0))):
                left -= new
            if left:
                raise RuntimeError(f"{left} messages of {rounds * publishers} did not come")

        put_and_get(1)
        began = process_time()
        put_and_get(rounds)
        return (process_time() - began) / (rounds * publishers)


def threads() -> tuple[int, int]:
    """Threads that reading a hundred named devices adds to a connected process: all of them, and those of Python."""

    def count() -> tuple[int, int]:
        return len(list(Path("/proc/self/task").iterdir())), threading.active_count()

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router([endpoint]), ZenohBus([endpoint]) as bus:
        before = count()
        stream = Client(ward=WARD, bus=bus).corrected([f"d{device}" for device in range(DEVICES)], quiet=True)
        stream.drain(0.5)
        after = count()
        stream.close()
    return after[0] - before[0], after[1] - before[1]


def main() -> int:
    """Print what it costs; no verdict."""
    console = Console()
    for words, messages in (("in order", in_order()), ("repeated and overtaken", mixed_up())):
        for how in (thread, loop):
            broker = MemoryBroker()
            bus = MemoryBus(broker)
            puts = {device: bus.publisher(keys.build(WARD, "corrected", device=device)).put for device, _ in messages}
            spent = 0.0

            def fill(messages: list[tuple[str, bytes]] = messages) -> None:
                nonlocal spent
                for device, payload in messages:
                    puts[device](payload)  # noqa: B023 # called before the next one
                spent = -process_time()

            given = how(Client(ward=WARD, bus=MemoryBus(broker)), fill)
            spent += process_time()
            each_us = 1e6 * spent / len(messages)
            share = 2000 * each_us / 1e6
            console.print(
                f"{words}, {how.__name__}: {each_us:.1f} µs a batch; {len(messages)} came, {given} given;"
                f" 100 devices at 20 a second: {share:.1%} of a core"
            )
    added, of_python = threads()
    console.print(
        f"reading {DEVICES} named devices adds {added} threads to a connected client, {of_python} of them Python's"
    )
    each_us = 1e6 * many_publishers()
    console.print(f"1000 publishers on a router: {each_us:.1f} µs a message, publisher, router and subscriber together")
    return 0


if __name__ == "__main__":
    sys.exit(main())
