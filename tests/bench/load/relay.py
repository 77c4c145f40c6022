"""A bare relay, which an estimator is held against: the bytes of raw/... put on corrected/... unread.

`python -m tests.bench.load.relay ENDPOINT`
"""

import sys
from collections.abc import Callable

from bridge.bus.zenoh_bus import ZenohBus
from bridge.runtime.signals import stopped_by_signal
from bridge.wire import keys
from estimator.service.device import CACHES
from tests.bench.load.stream import WARD


def main(endpoint: str) -> None:
    """Until a signal comes."""
    with stopped_by_signal() as stop, ZenohBus([endpoint]) as bus:
        raw = bus.subscribe(keys.pattern(WARD, "raw"), history=True)
        puts: dict[str, Callable[[bytes], None]] = {}
        while not stop.is_set():
            for key, payload in raw.drain(512, 0.05):
                put = puts.get(key)
                if put is None:
                    out = keys.build(WARD, "corrected", device=keys.parse(key).device)
                    put = puts[key] = bus.publisher(out, cache=CACHES["corrected"]).put
                put(payload)


if __name__ == "__main__":
    main(sys.argv[1])
