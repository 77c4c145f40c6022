"""What router kills cost: 200 publishers, one subscriber, a router that is killed again and again. `make bench`.

Goal: each message once and in order, none lost. Processor time a message is that of the subscriber and of the publishers alone.
`python -m tests.bench.router_kills --help`.
"""

import argparse
import contextlib
import json
import signal
import sys
import time
from collections import Counter

import numpy as np
from rich.console import Console

from bridge.bus.contract import Subscription
from bridge.bus.zenoh_bus import ZenohBus
from estimator.demo.ward import free_port
from tests.bench.programs import line, program

PERIOD_S, DOWN_S, LAST_S = 0.2, 0.5, 45.0


def send(endpoint: str, publishers: int, seconds: float) -> None:
    """Put numbers under each key in turn; print how many of each, and the processor time of it all."""
    with ZenohBus([endpoint]) as bus:
        made = [bus.publisher(f"t/@v1/{n}", cache=200) for n in range(publishers)]
        time.sleep(1.0)
        began, spent, number = time.monotonic(), time.process_time(), 0
        while time.monotonic() - began < seconds:
            for n, publisher in enumerate(made):
                publisher.put(b"%d" % number)
                due = began + (number + n / len(made)) * PERIOD_S
                if n % 10 == 0:
                    time.sleep(max(0.0, due - time.monotonic()))
            number += 1
        print(json.dumps({"each": number, "cpu": time.process_time() - spent}), flush=True)
        sys.stdin.readline()  # the caches stay until all has been repaired


class Heard:
    """What came, by key."""

    def __init__(self, subscription: Subscription) -> None:
        self._subscription = subscription
        self.next: Counter[str] = Counter()
        self.came = self.twice = self.skipped = 0
        self._last: dict[str, float] = {}
        self.hole_s = 0.0

    def read(self, seconds: float) -> None:
        """For so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            for key, payload in self._subscription.drain(4096, min(left, 0.05)):
                number, now = int(payload), time.monotonic()
                self.came += 1
                self.twice += number < self.next[key]
                self.skipped += max(0, number - self.next[key])
                self.next[key] = max(self.next[key], number + 1)
                self.hole_s = max(self.hole_s, now - self._last.get(key, now))
                self._last[key] = now


def main() -> int:
    """Print a line; 1 when anything was lost, came twice or out of order."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--publishers", type=int, default=200)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--every", type=float, default=2.0, metavar="S")
    parser.add_argument("--send", default="", metavar="ENDPOINT", help="be the publishers")
    args = parser.parse_args()
    seconds = (args.kills + 2) * args.every
    if args.send:
        send(args.send, args.publishers, seconds)
        return 0
    endpoint, rng = f"tcp/127.0.0.1:{free_port()}", np.random.default_rng(1)
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(program("tests.bench.router", endpoint, pipe=True))
        line(router)
        bus = stack.enter_context(ZenohBus([endpoint]))
        heard = Heard(bus.subscribe("t/@v1/*", history=True))
        words = ("tests.bench.router_kills", *sys.argv[1:], "--send", endpoint)
        sender = stack.enter_context(program(*words, pipe=True))
        spent = time.process_time()
        heard.read(1.0)
        for _ in range(args.kills):
            heard.read(rng.uniform(0.5, 1.5) * args.every - DOWN_S)
            router.send_signal(signal.SIGKILL)
            router.wait()
            heard.read(DOWN_S)
            router = stack.enter_context(program("tests.bench.router", endpoint, pipe=True))
        heard.read(args.every)
        said = json.loads(line(sender))
        total, deadline = said["each"] * args.publishers, time.monotonic() + LAST_S
        while heard.came < total and time.monotonic() < deadline:
            heard.read(0.5)
        spent = time.process_time() - spent
        lost = total - heard.came + heard.twice
        Console().print(
            f"{args.publishers} publishers, {args.kills} router kills: {total} sent, {lost} lost, {heard.twice} twice or late,"
            f" {heard.skipped} skipped, {heard._subscription.missed} told as missed; longest hole {heard.hole_s:.2f} s;"
            f" µs of processor a message: subscriber {1e6 * spent / total:.0f}, publishers {1e6 * said['cpu'] / total:.0f}"
        )
    return int(lost > 0 or heard.twice > 0 or heard.skipped > 0)


if __name__ == "__main__":
    sys.exit(main())
