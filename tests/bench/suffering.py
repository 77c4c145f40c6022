"""Who suffers when somebody misbehaves: one should, and nobody else. `make bench-faults`.

100 devices at 104 Hz in batches of 5 (where somebody is frozen: at 562.5 Hz in batches of 28) through a router of ours and an
estimator, all processes of their own. In one run each: nobody misbehaves; a subscriber of corrected rates, or of raw samples,
is stopped (SIGSTOP) for ten seconds; one device sends 10,000 batches a second under its key; the store's disk takes 2 s for
every fsync. Latency is from the sender's put to a healthy subscriber; a hole is the longest time in which that subscriber
heard nothing of any device, or nothing of one.
"""

import argparse
import contextlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bridge.bus.zenoh_bus import ZenohBus
from estimator.client import Client
from estimator.demo.ward import free_port
from tests.bench.load.receiver import Receiver
from tests.bench.load.stream import WARD, Fleet, listed, name
from tests.bench.programs import estimator, line, program, router, ward_file

DEVICES, USUAL, FAST = 100, (104.0, 5), (562.5, 28)
#: a hole while somebody is frozen, s, and p99 under a flood over that of none
HOLE_S, SLOWER = 0.15, 2.0
FROZEN_S = 10.0
FLOOD_HZ = 10_000
_SLOW_DISK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <unistd.h>
int fsync(int fd) { sleep(2); return ((int (*)(int))dlsym(RTLD_NEXT, "fsync"))(fd); }
int fdatasync(int fd) { sleep(2); return ((int (*)(int))dlsym(RTLD_NEXT, "fdatasync"))(fd); }
"""


@dataclass(frozen=True, slots=True)
class Suffered:
    """By those who did nothing: latency in s, holes in s, samples lost."""

    p50_s: float
    p99_s: float
    worst_s: float
    hole_s: float
    device_hole_s: float
    lost: int
    said: str


def flood(endpoint: str, fleet: Fleet, until: threading.Event) -> None:
    """The last device's first message again and again, in bursts each millisecond."""
    [(_, payload)] = [made for made in fleet.round(0, time.time_ns()) if made[0] == fleet.n - 1]
    with ZenohBus([endpoint]) as bus:
        publisher = bus.publisher(fleet.keys[-1])
        due = time.monotonic()
        while not until.is_set():
            for _ in range(FLOOD_HZ // 1000):
                publisher.put(payload)
            due += 1e-3
            time.sleep(max(0.0, due - time.monotonic()))


def run(trouble: str, seconds: float) -> Suffered:
    """One run."""
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder, endpoint = Path(place), f"tcp/127.0.0.1:{free_port()}"
        file = ward_file(folder, WARD, endpoint, listed(DEVICES))
        stack.enter_context(router(file, endpoint))
        env = {"LD_PRELOAD": str(_slow_disk(folder))} if trouble == "slow disk" else None
        stack.enter_context(estimator(file, env))
        healthy = Receiver(endpoint)
        stack.callback(healthy.close)
        victim = None
        if trouble.startswith("frozen "):
            words = ["tests.bench.subscriber", endpoint, WARD, trouble.removeprefix("frozen ")]
            victim = stack.enter_context(program(*words, pipe=True))
            line(victim)
        fleet = Fleet(DEVICES, *(FAST if "frozen" in trouble or "fast" in trouble else USUAL))
        bus = stack.enter_context(ZenohBus([endpoint]))
        publishers = [bus.publisher(key, cache=round(5.0 / fleet.period_s)) for key in fleet.keys]
        time.sleep(1.0)
        stop = threading.Event()
        flooder = threading.Thread(target=flood, args=(endpoint, fleet, stop))
        rounds, due, begun_ns = round(seconds / fleet.period_s), time.monotonic(), 0
        for number in range(rounds):
            if number == rounds // 4:  # all is running: it begins
                begun_ns = time.time_ns()
                if victim is not None:
                    victim.send_signal(signal.SIGSTOP)
                if trouble == "flood":
                    flooder.start()
            if victim is not None and number == rounds // 4 + round(FROZEN_S / fleet.period_s):
                victim.send_signal(signal.SIGCONT)
            for i, payload in fleet.round(number, time.time_ns()):
                publishers[i].put(payload)
            due += fleet.period_s
            time.sleep(max(0.0, due - time.monotonic()))
        stop.set()
        if flooder.ident:
            flooder.join()
        time.sleep(2.0)
        said = _said(endpoint) if trouble == "flood" else ""
        return _judged(healthy, rounds, begun_ns, fleet, said)


def _said(endpoint: str) -> str:
    """What the estimator tells of the device that floods."""
    with Client((endpoint,), ward=WARD) as client:
        status = client.statuses(wait_s=1.5).get(name(DEVICES - 1))
    return f"{dict(status.events)}, dropped {status.dropped}" if status else "nothing"


def _judged(healthy: Receiver, rounds: int, begun_ns: int, fleet: Fleet, said: str) -> Suffered:
    innocent = {name(i) for i in range(fleet.n - 1)}
    came = [(came_ns, batch) for came_ns, batch in healthy.batches() if batch.device in innocent]
    latency = [(came_ns - batch.start_time_ns) * 1e-9 for came_ns, batch in came if came_ns >= begun_ns]
    moments = np.array([came_ns for came_ns, _ in came if came_ns >= begun_ns])
    device_hole_s = max(longest_silence_s(healthy.heard, innocent, begun_ns, int(moments[-1])).values())
    lost = len(innocent) * rounds * fleet.batch - sum(
        n for device, n in healthy.samples().items() if device in innocent
    )
    p50, p99 = np.percentile(latency, (50, 99))
    hole_s = float(np.diff(moments).max()) * 1e-9
    return Suffered(float(p50), float(p99), max(latency), hole_s, device_hole_s, lost, said)


def longest_silence_s(
    heard: list[tuple[int, str, bytes]], devices: set[str], since_ns: int, until_ns: int
) -> dict[str, float]:
    """Of each of these devices the longest part of a time in which nothing of it came."""
    last, longest = dict.fromkeys(devices, since_ns), dict.fromkeys(devices, 0)
    for came_ns, key, _ in [*heard, *((until_ns, device, b"") for device in devices)]:
        device = key.rpartition("/")[2]
        if device in last and came_ns >= since_ns:
            longest[device] = max(longest[device], came_ns - last[device])
            last[device] = came_ns
    return {device: ns * 1e-9 for device, ns in longest.items()}


def _slow_disk(folder: Path) -> Path:
    compiler = shutil.which("cc")
    if compiler is None:
        raise RuntimeError("a slow disk needs a C compiler")
    source, made = folder / "slow.c", folder / "slow.so"
    source.write_text(_SLOW_DISK, encoding="utf-8")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", made, source, "-ldl"], check=True)
    return made


TROUBLES = (
    "none",
    "flood",
    "slow disk",
    "none again",
    "none, fast",
    "frozen corrected",
    "frozen raw",
    "none, fast again",
)


def unreached(found: Mapping[str, Suffered]) -> list[str]:
    """Which goals were missed, by trouble: holes of who is not frozen, latency under a flood beside that of none, samples."""
    missed = [f"{trouble}: {s.lost} samples lost (goal 0)" for trouble, s in found.items() if s.lost]
    for trouble, s in found.items():
        longest_s = max(s.hole_s, s.device_hole_s)
        if trouble.startswith("frozen ") and longest_s > HOLE_S:
            missed.append(f"{trouble}: a hole of {1e3 * longest_s:.0f} ms (goal {1e3 * HOLE_S:g})")
    if {"none", "flood"} <= found.keys() and (ratio := found["flood"].p99_s / found["none"].p99_s) > SLOWER:
        missed.append(f"flood: p99 {ratio:.2f} times that of none (goal {SLOWER:g})")
    return missed


def main() -> int:
    """Print a table; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--only", action="append", choices=TROUBLES, default=[])
    args = parser.parse_args()
    console = Console(width=160)
    table = Table(
        title="What the others suffer",
        caption="ms; holes while somebody is frozen: goal 150 ms; p99 under flood: goal twice that of none",
    )
    for heading in ("trouble", "p50", "p99", "worst", "longest hole", "of one device", "samples lost", "said"):
        table.add_column(heading, justify="right")
    found: dict[str, Suffered] = {}
    for trouble in args.only or TROUBLES:
        s = found[trouble] = run(trouble, args.seconds)
        console.print(f"{trouble}: done", style="dim")
        times = (s.p50_s, s.p99_s, s.worst_s, s.hole_s, s.device_hole_s)
        table.add_row(trouble, *(f"{1e3 * t:.1f}" for t in times), str(s.lost), s.said)
    console.print(table)
    if missed := unreached(found):
        console.print(f"not reached: {'; '.join(missed)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
