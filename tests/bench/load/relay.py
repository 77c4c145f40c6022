"""A bare relay: the bytes of raw/... put on corrected/... unread. `python -m tests.bench.load.relay ENDPOINT`"""

import sys
from collections.abc import Callable

from bridge.bus.contract import Publisher
from bridge.bus.zenoh_bus import ZenohBus
from bridge.process import stopped_by_signal
from bridge.wire import keys
from estimator.service.device import CACHES
from tests.bench.load.stream import WARD


def main(endpoint: str) -> None:
    """Until a signal comes."""
    with stopped_by_signal() as stop, ZenohBus([endpoint]) as bus:
        raw = bus.subscribe(keys.pattern(WARD, "raw"), history=True)
        puts: dict[str, Callable[[bytes], None]] = {}

        def publisher(key: str) -> Publisher:
            device = keys.parse(key).device
            return bus.publisher(keys.build(WARD, "corrected", device=device), cache=CACHES["corrected"])

        while not stop.is_set():
            for key, payload in raw.drain(512, 0.05):
                put = puts.get(key)
                if put is None:
                    put = puts[key] = publisher(key).put
                put(payload)


if __name__ == "__main__":
    main(*sys.argv[1:])
