"""Raw and corrected rates, statuses and infos of many devices, as a process: `python -m tests.bench.crowd ENDPOINT DEVICES`."""

import sys

from bridge.bus.zenoh_bus import ZenohBus
from bridge.runtime.signals import stopped_by_signal
from bridge.wire import keys
from tests.bridge.recording.crowd import WARD, Crowd


def main(endpoint: str, devices: str) -> None:
    """Until a signal comes."""
    with stopped_by_signal() as stop, ZenohBus([endpoint], open_timeout_s=20) as bus:
        for kind in ("bridge", "estimator"):
            bus.declare_alive(keys.build(WARD, f"alive/{kind}", **{kind: "one"}))
        with Crowd(bus, int(devices)):
            stop.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
