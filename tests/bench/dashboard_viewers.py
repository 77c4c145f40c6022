"""Do fifty viewers of the dashboard slow the estimator? `make bench`.

Sixty devices at 100 Hz, a real estimator and a real dashboard, each a process; a subscriber that says how old each corrected
sample is when it comes. By turns nobody looks and fifty do, in one run: whatever else the machine does weighs on both alike.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from estimator.client import Client, Corrected
from estimator.demo.ward import free_port, listens
from tests.bench.dashboard import CLI, NAMES, cpu_s, process, ward_file
from tests.ward.shared import WARD, Bridge

#: viewers are other machines: here they may only have what is left
_NICE = "19"
_SETTLE_S = 4.0


def read(endpoint: str) -> None:
    """A bridge, until stdin ends."""
    bridge = Bridge(ZenohBus((endpoint,), open_timeout_s=20), NAMES)
    sys.stdin.read()
    bridge.stop()


def late(stream: Corrected, seconds: float) -> np.ndarray:
    """How many ms after it was read each message of these seconds came."""
    stream.drain()
    end, found = time.monotonic() + seconds, []
    while time.monotonic() < end:
        if (batch := stream.receive(0.2)) is not None:
            found.append((time.time_ns() - batch.start_time_ns) / 1e6)
    return np.array(found)


def main() -> int:
    """Print it; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--read")
    given = parser.parse_args()
    if given.read:
        read(given.read)
        return 0
    console = Console()
    router, web = f"tcp/127.0.0.1:{free_port()}", free_port()
    with tempfile.TemporaryDirectory() as folder:
        file = ward_file(Path(folder), router, web, WARD)
        with file.open("a", encoding="utf-8") as more:
            more.write(f'[estimator]\nid = "one"\nstore = "{folder}/store.sqlite3"\n')
        with process(*CLI, "router", "--config", str(file)):
            listens(router, 20)
            with (
                process(*CLI, "estimator", "serve", str(file)) as estimator,
                process("-m", "tests.bench.dashboard_viewers", "--read", router),
                process(*CLI, "dashboard", "--config", str(file)) as dashboard,
                Client((router,), ward=WARD) as client,
            ):
                listens(f"tcp/127.0.0.1:{web}", 60)
                stream = client.corrected()
                late(stream, 10.0)
                for _ in range(given.rounds):
                    for viewers in (0, given.viewers):
                        _measure(console, stream, (estimator.pid, dashboard.pid), web, viewers, given.seconds)
    return 0


def _measure(
    console: Console, stream: Corrected, pids: tuple[int, int], web: int, viewers: int, seconds: float
) -> None:
    crowd = None
    if viewers:
        lasting = ["--viewers", str(viewers), "--seconds", str(seconds + _SETTLE_S)]
        arguments = ["-m", "tests.bench.dashboard", "--crowd", f"ws://127.0.0.1:{web}/live", *lasting]
        crowd = subprocess.Popen(["nice", "-n", _NICE, sys.executable, *arguments], stdout=subprocess.PIPE)
    late(stream, _SETTLE_S)
    before, begin = [cpu_s(pid) for pid in pids], time.monotonic()
    ms = late(stream, seconds)
    used = [(cpu_s(pid) - was) / (time.monotonic() - begin) for pid, was in zip(pids, before, strict=True)]
    slowest, fastest = crowd.communicate()[0].decode().split() if crowd else ("", "")
    each = f"; {slowest} to {fastest} frames/s each" if crowd else ""
    half, most = np.percentile(ms, [50, 99])
    console.print(
        f"{viewers} viewers: corrected samples come after {half:.1f} ms (99 %: {most:.1f}), {len(ms) / seconds:.0f} messages/s; "
        f"estimator {used[0]:.1%} of a core, dashboard {used[1]:.1%}{each}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    sys.exit(main())
