"""What a subscriber costs and bears: batches a second of CPU time, in a thread and in an event loop, and many publishers on a
real router. `make bench`.
"""

import asyncio
import sys
from collections.abc import Callable
from dataclasses import replace
from time import process_time

import numpy as np
from rich.console import Console

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.bus.router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.client import Client
from estimator.demo.ward import free_port
from tests.estimator.shuffled import delivered, make_boot
from tests.estimator.test_revision import batch

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
    """The same of a network that repeats and overtakes."""
    rng = np.random.default_rng(1)
    boots = [make_boot(rng, f"d{device}", 1, BATCHES * SAMPLES, 0) for device in range(DEVICES)]
    return [(one.device, codec.encode_corrected(replace(one))) for one in delivered(rng, boots, 50)]


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
    each_us = 1e6 * many_publishers()
    console.print(f"1000 publishers on a router: {each_us:.1f} µs a message, publisher, router and subscriber together")
    return 0


if __name__ == "__main__":
    sys.exit(main())
