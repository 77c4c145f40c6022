"""`truerate outlet foxglove` for twenty devices: does a client receive every sample once, and what does the outlet cost?

    python -m tests.bench.foxglove [--devices 20] [--seconds 60] [--deaf]

With --deaf a second client subscribes to everything and reads nothing. Exit code 1 where a sample is missing or comes twice, or
where the outlet takes more than GOAL of a core.
"""

import argparse
import sys
import time
from collections import defaultdict
from contextlib import ExitStack

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from estimator.demo.ward import free_port
from tests.bench.programs import CLI, cpu_s, line, program, rss_mb
from tests.bridge.recording.crowd import STEP, WARD, Crowd
from tests.estimator.outlets.foxglove_client import FoxgloveClient

GOAL = 0.20
STEP_NS = STEP * 1000
#: time until all channels are known and subscribed to, s
SETTLE_S = 3.0


def main() -> int:
    """Print what came and what it cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--deaf", action="store_true")
    given = parser.parse_args()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    times: defaultdict[str, list[int]] = defaultdict(list)

    def take(client: FoxgloveClient, wait_s: float) -> bool:
        if (one := client.receive(wait_s)) is None:
            return False
        if one.topic.endswith("/imu"):
            times[one.topic].append(one.time_ns)
        return True

    with ExitStack() as stack:
        stack.enter_context(Router([endpoint]))
        bus = stack.enter_context(ZenohBus([endpoint]))
        words = ["outlet", "foxglove", "--ward", WARD, "--connect", endpoint, "--port", "0"]
        outlet = stack.enter_context(program(CLI, *words, pipe=True))
        port = int(line(outlet).rpartition(":")[2])
        crowd = stack.enter_context(ExitStack())
        sending = crowd.enter_context(Crowd(bus, given.devices))
        client = stack.enter_context(FoxgloveClient(port))
        if given.deaf:
            deaf, until = stack.enter_context(FoxgloveClient(port)), time.monotonic() + SETTLE_S / 2
            while time.monotonic() < until:
                deaf.receive(0.05)
        until = time.monotonic() + SETTLE_S
        while time.monotonic() < until:
            take(client, 0.5)
        began, spent_s, before_mb = time.monotonic(), cpu_s(outlet.pid), rss_mb(outlet.pid)
        while time.monotonic() - began < given.seconds:
            take(client, 0.5)
        share = (cpu_s(outlet.pid) - spent_s) / (time.monotonic() - began)
        crowd.close()
        while take(client, 1.0):
            pass
        after_mb = rss_mb(outlet.pid)
    missing = twice = 0
    for of_device in times.values():
        twice += len(of_device) - len(set(of_device))
        missing += (max(of_device) - min(of_device)) // STEP_NS + 1 - len(set(of_device))
    last = {max(of_device) for of_device in times.values()}
    whole = len(times) == given.devices == len(sending.names) and len(last) == 1
    print(
        f"{len(times)} devices, {sum(map(len, times.values()))} samples in {given.seconds:.0f} s:"
        f" {missing} missing, {twice} twice{'' if whole else ', devices end at different samples'};"
        f" {share:.1%} of a core (goal {GOAL:.0%}); {before_mb:.0f} → {after_mb:.0f} MB"
        f"{' with a client that does not read' if given.deaf else ''}"
    )
    return int(bool(missing or twice or not whole or share > GOAL))


if __name__ == "__main__":
    sys.exit(main())
