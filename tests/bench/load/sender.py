"""A bridge of many devices, as a process: paced, a share of the devices at a time as the pump does; or a burst, all at once.

`python -m tests.bench.load.sender ENDPOINT DEVICES RATE_HZ BATCH paced SECONDS WARM_S` or `... burst MESSAGES 0`
"""

import json
import sys
import time

from bridge.bus.zenoh_bus import ZenohBus
from bridge.ingest.pump import cached, shares
from tests.bench.load.stream import Fleet


def main(endpoint: str, devices: str, rate_hz: str, batch: str, mode: str, amount: str, warm_s: str) -> None:
    """Print, as JSON, what was sent and when it began."""
    fleet = Fleet(int(devices), float(rate_hz), int(batch))
    with ZenohBus([endpoint]) as bus:
        publishers = [bus.publisher(key, cache=cached(fleet.period_s)) for key in fleet.keys]
        time.sleep(1.0)  # for everybody to learn of so many
        rounds = round(float(amount) / fleet.period_s) if mode == "paced" else int(amount) // fleet.n
        made = [list(fleet.round(i, time.time_ns())) for i in range(rounds)] if mode == "burst" else None
        warm, parts = round(float(warm_s) / fleet.period_s), shares(fleet.n)
        due_s, late_s = time.monotonic(), 0.0
        for number in range(warm + rounds):
            if number == warm:
                print(json.dumps({"before": warm * fleet.n}), flush=True)
                late_s = 0.0
            if made is not None:
                for i, payload in made[number]:
                    publishers[i].put(payload)
                continue
            for part in range(parts):
                for i, payload in fleet.round(number, time.time_ns(), range(part, fleet.n, parts)):
                    publishers[i].put(payload)
                due_s += fleet.period_s / parts
                late_s = max(late_s, time.monotonic() - due_s)
                time.sleep(max(0.0, due_s - time.monotonic()))
        print(json.dumps({"sent": (warm + rounds) * fleet.n, "late_s": late_s}), flush=True)
        sys.stdin.readline()  # the caches stay until all has been repaired


if __name__ == "__main__":
    main(*sys.argv[1:])
