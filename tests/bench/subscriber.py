"""A subscriber in a process of its own, to be frozen. `python -m tests.bench.subscriber ENDPOINT WARD WHAT`; says `ready`."""

import sys

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys


def main(endpoint: str, ward: str, what: str) -> None:
    """Read until ended."""
    with ZenohBus([endpoint]) as bus:
        subscription = bus.subscribe(keys.pattern(ward, what), history=what == "raw")
        print("ready", flush=True)
        while True:
            subscription.drain(512, 1.0)


if __name__ == "__main__":
    main(*sys.argv[1:])
