"""`truerate outlet foxglove` for twenty devices: does a client receive every sample once, and what does the outlet cost?

    python -m tests.bench.foxglove [--devices 20] [--seconds 60] [--deaf]

With --deaf a second client subscribes to everything and reads nothing. Exit code 1 where a sample is missing or comes twice, or
where the outlet takes more than GOAL of a core.
"""

import argparse
import os
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from estimator.demo.ward import free_port
from tests.bridge.recording.crowd import STEP, WARD, Crowd
from tests.estimator.outlets.foxglove_client import FoxgloveClient

GOAL = 0.20
STEP_NS = STEP * 1000
#: time until all channels are known and subscribed to, s
SETTLE_S = 3.0


def cpu_s(pid: int) -> float:
    """Processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--deaf", action="store_true")
    given = parser.parse_args()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    times: defaultdict[str, list[int]] = defaultdict(list)
    with ExitStack() as stack:
        stack.enter_context(Router([endpoint]))
        bus = stack.enter_context(ZenohBus([endpoint]))
        words = ["outlet", "foxglove", "--ward", WARD, "--connect", endpoint, "--port", "0"]
        outlet = stack.enter_context(
            subprocess.Popen([sys.executable, "-m", "estimator", *words], stdout=subprocess.PIPE, text=True)
        )
        stack.callback(outlet.terminate)
        assert outlet.stdout is not None
        port = int(outlet.stdout.readline().rpartition(":")[2])
        crowd = stack.enter_context(ExitStack())
        sending = crowd.enter_context(Crowd(bus, given.devices))
        client = stack.enter_context(FoxgloveClient(port))
        if given.deaf:
            deaf = stack.enter_context(FoxgloveClient(port))
            begin = time.monotonic()
            while time.monotonic() - begin < SETTLE_S / 2:
                deaf.receive(0.05)
        begin, spent_s = time.monotonic(), 0.0
        before_mb = resident_mb(outlet.pid)
        while (since := time.monotonic() - begin) < SETTLE_S + given.seconds:
            one = client.receive(0.5)
            if since < SETTLE_S:
                spent_s, before_mb = -cpu_s(outlet.pid), resident_mb(outlet.pid)
                counted_from = time.monotonic()
            elif one is not None and one.topic.endswith("/imu"):
                times[one.topic].append(one.time_ns)
        spent_s += cpu_s(outlet.pid)
        took_s = time.monotonic() - counted_from
        crowd.close()
        while (one := client.receive(1.0)) is not None:
            if one.topic.endswith("/imu"):
                times[one.topic].append(one.time_ns)
        after_mb = resident_mb(outlet.pid)
    missing = twice = 0
    for of_device in times.values():
        twice += len(of_device) - len(set(of_device))
        missing += (max(of_device) - min(of_device)) // STEP_NS + 1 - len(set(of_device))
    last = {max(of_device) for of_device in times.values()}
    whole = len(times) == given.devices == len(sending.names) and len(last) == 1
    share = spent_s / took_s
    print(
        f"{len(times)} devices, {sum(map(len, times.values()))} samples in {took_s:.0f} s:"
        f" {missing} missing, {twice} twice{'' if whole else ', devices end at different samples'};"
        f" {share:.1%} of a core (goal {GOAL:.0%}); {before_mb:.0f} → {after_mb:.0f} MB"
        f"{' with a client that does not read' if given.deaf else ''}"
    )
    return int(bool(missing or twice or not whole or share > GOAL))


if __name__ == "__main__":
    sys.exit(main())
