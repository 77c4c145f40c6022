"""What `truerate watch` costs with a thousand devices: the share of a core. `make bench`."""

import sys
import threading
import time
from dataclasses import replace
from io import StringIO
from time import process_time, thread_time

from rich.console import Console

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import State
from estimator.client import Client
from estimator.session import DeviceSession
from estimator.watch_ward import watch_ward
from tests.estimator.stream import info
from tests.sentences import free

WARD, DEVICES, SECONDS, HEIGHT, WIDTH = "w", 1000, 20.0, 50, 160


def talk(broker: MemoryBroker, stop: threading.Event, spent: list[float]) -> None:
    """A status and an info of every device a second, as estimator and bridge send them."""
    bus = MemoryBus(broker)
    puts = []
    for n in range(DEVICES):
        name = f"device-{n:04d}"
        state = State.LOST if n % 100 == 0 else State.DEGRADED if n % 37 == 0 else State.TRACKING
        words = "at rest 12 s ago; calibrated this morning by three turns"
        status = replace(
            DeviceSession(name).status(7), state=state, reason=free(words), rate_hz=104.2, events={"gaps": n % 5}
        )
        put_status = bus.publisher(keys.build(WARD, "status", device=name), cache=1).put
        put_info = bus.publisher(keys.build(WARD, "info", bridge="bridge", device=name), cache=1).put
        puts.append((put_status, codec.encode_status(status)))
        puts.append((put_info, codec.encode_info(replace(info(), device=name, battery_percent=50.0))))
    begin = thread_time()
    while not stop.is_set():
        for put, payload in puts:
            put(payload)
        stop.wait(1.0)
    spent.append(thread_time() - begin)


def main() -> int:
    """Print what it costs; no verdict."""
    broker, stop, talking = MemoryBroker(), threading.Event(), list[float]()
    talker = threading.Thread(target=talk, args=(broker, stop, talking))
    talker.start()
    console = Console(file=StringIO(), force_terminal=True, width=WIDTH, height=HEIGHT)
    client = Client(ward=WARD, bus=MemoryBus(broker))
    time.sleep(0.5)
    begin, spent = time.monotonic(), process_time()
    watch_ward(console, client, seconds=SECONDS)
    elapsed, spent = time.monotonic() - begin, process_time() - spent
    stop.set()
    talker.join()
    share = (spent - talking[0]) / elapsed
    Console().print(f"{DEVICES} devices, {WIDTH} by {HEIGHT}: {share:.1%} of a core ({elapsed:.0f} s)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
