"""Costs of a subscriber: processor time a batch, and its threads."""

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from time import process_time

from rich.console import Console

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.client import Client
from estimator.demo.ward import free_port
from tests.estimator.client.test_revision import batch
from tests.memory_bus import MemoryBroker, MemoryBus

WARD, DEVICES, BATCHES, SAMPLES = "w", 100, 600, 5


def in_order() -> list[tuple[str, bytes]]:
    """Half a minute of a hundred devices, twenty batches a second, as they come."""
    found = []
    for n in range(BATCHES):
        for device in range(DEVICES):
            one = batch(n * SAMPLES, SAMPLES, device=f"d{device}")
            found.append((one.device, codec.encode_corrected(one)))
    return found


def thread(client: Client, fill: Callable[[], None]) -> int:
    """Batches read by `for`."""
    stream = client.corrected(idle_s=0.2, queue=10**6)
    fill()
    return sum(1 for _ in stream)


def threads() -> tuple[int, int]:
    """Threads that reading a hundred named devices adds to a connected process: all of them, and those of Python."""

    def count() -> tuple[int, int]:
        return len(list(Path("/proc/self/task").iterdir())), threading.active_count()

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router([endpoint]), ZenohBus([endpoint]) as bus, Client(ward=WARD, bus=bus) as client:
        before = count()
        stream = client.corrected([f"d{device}" for device in range(DEVICES)], quiet=True)
        stream.drain(0.5)
        after = count()
        stream.close()
    return after[0] - before[0], after[1] - before[1]


def main() -> int:
    """Print what it costs; no verdict."""
    console, messages = Console(), in_order()
    broker = MemoryBroker()
    bus = MemoryBus(broker)
    puts = {device: bus.publisher(keys.build(WARD, "corrected", device=device)).put for device, _ in messages}
    spent = 0.0

    def fill() -> None:
        nonlocal spent
        for device, payload in messages:
            puts[device](payload)
        spent = -process_time()

    with Client(ward=WARD, bus=MemoryBus(broker)) as client:
        given = thread(client, fill)
        spent += process_time()
    each_us = 1e6 * spent / len(messages)
    console.print(
        f"{each_us:.1f} µs a batch; {given} of {len(messages)} given; 100 devices at 20 a second: {2e-3 * each_us:.1%} of a core"
    )
    added, of_python = threads()
    console.print(
        f"reading {DEVICES} named devices adds {added} threads to a connected client, {of_python} of them Python's"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
