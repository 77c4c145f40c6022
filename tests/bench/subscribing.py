"""How many threads a subscriber of a hundred devices adds to a connected program, all of them and Python's own (goal 4)."""

import sys
import threading
from pathlib import Path

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from estimator.client import Client
from estimator.demo.ward import free_port

DEVICES = 100


def threads() -> tuple[int, int]:
    """Of this process: all of them, and those of Python."""
    return len(list(Path("/proc/self/task").iterdir())), threading.active_count()


def main() -> int:
    """Print it; no verdict."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router([endpoint]), ZenohBus([endpoint]) as bus, Client(ward="w", bus=bus) as client:
        before = threads()
        stream = client.corrected([f"d{device}" for device in range(DEVICES)], quiet=True)
        stream.drain(0.5)
        added, of_python = (now - then for now, then in zip(threads(), before, strict=True))
        stream.close()
    print(f"reading {DEVICES} named devices adds {added} threads to a connected client, {of_python} of them Python's")
    return 0


if __name__ == "__main__":
    sys.exit(main())
