"""Who suffers when somebody misbehaves: one should, and nobody else. `make bench-faults`.

100 devices at 104 Hz in batches of 5 (where somebody is frozen: at 562.5 Hz in batches of 28) through a router of ours and an
estimator, all processes of their own. In one run each: nobody misbehaves; a subscriber of corrected rates, or of raw samples,
is stopped (SIGSTOP) for ten seconds; one device sends 10,000 batches a second under its key; the store's disk takes 2 s for
every fsync. Latency is from the sender's put to a healthy subscriber; a hole is the longest time in which that subscriber
heard nothing of any device, or nothing of one.
"""

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from estimator.client import Client
from estimator.demo.ward import free_port, listens
from tests.bench.load.stream import WARD, Fleet, listed, name

DEVICES, USUAL, FAST = 100, (104.0, 5), (562.5, 28)
#: a hole while somebody is frozen, s, and p99 under a flood over that of none
HOLE_S, SLOWER = 0.15, 2.0
FROZEN_S = 10.0
FLOOD_HZ = 10_000
_CONFIG = """ward = "{ward}"
[bus]
connect = ["{endpoint}"]
[router]
listen = ["{endpoint}"]
[estimator]
id = "e"
store = "{folder}/store.sqlite3"
"""
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


class Healthy(threading.Thread):
    """A subscriber that reads: when each message came, of which device, and how long it took."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(daemon=True)
        self._bus = ZenohBus([endpoint])
        self._corrected = self._bus.subscribe(keys.pattern(WARD, "corrected"), history=True)
        self.heard: list[tuple[int, str, bytes]] = []
        self.over = False
        self.start()

    def run(self) -> None:
        while not self.over:
            messages = self._corrected.drain(512, 0.05)
            now_ns = time.time_ns()
            self.heard += [(now_ns, message.key, message.payload) for message in messages]

    def close(self) -> None:
        self.over = True
        self.join()
        self._bus.close()


@contextlib.contextmanager
def process(*words: str, env: dict[str, str] | None = None, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("ab") as out:
        started = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdout=out,
            stderr=out,
            stdin=subprocess.DEVNULL,
            env=os.environ | (env or {}),
        )
    try:
        yield started
    finally:
        started.send_signal(signal.SIGCONT)
        started.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(15)
        started.kill()
        started.wait()


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
        config = folder / "ward.toml"
        config.write_text(
            _CONFIG.format(ward=WARD, endpoint=endpoint, folder=folder) + listed(DEVICES), encoding="utf-8"
        )
        env = {"LD_PRELOAD": str(_slow_disk(folder))} if trouble == "slow disk" else None
        stack.enter_context(process("estimator.cli.main", "router", "--config", str(config), log=folder / "router.log"))
        if not listens(endpoint, 20.0):
            raise RuntimeError("the router does not listen")
        log = folder / "estimator.log"
        stack.enter_context(process("estimator.cli.main", "estimator", "serve", str(config), env=env, log=log))
        while "serves ward" not in log.read_text():
            time.sleep(0.1)
        healthy = Healthy(endpoint)
        stack.callback(healthy.close)
        victim = None
        if trouble.startswith("frozen "):
            heard = folder / "frozen.log"
            what = trouble.removeprefix("frozen ")
            victim = stack.enter_context(process("tests.bench.subscriber", endpoint, WARD, what, log=heard))
            while "ready" not in heard.read_text():
                time.sleep(0.05)
        fleet, bus = (
            Fleet(DEVICES, *(FAST if "frozen" in trouble or "fast" in trouble else USUAL)),
            stack.enter_context(ZenohBus([endpoint])),
        )
        publishers = [bus.publisher(key, cache=round(5.0 / fleet.period_s)) for key in fleet.keys]
        time.sleep(1.0)
        stop = threading.Event()
        flooder = threading.Thread(target=flood, args=(endpoint, fleet, stop))
        rounds, due, put_longest = round(seconds / fleet.period_s), time.monotonic(), 0.0
        begun_ns = 0
        for number in range(rounds):
            if number == rounds // 4:  # all is running: it begins
                begun_ns = time.time_ns()
                if victim is not None:
                    victim.send_signal(signal.SIGSTOP)
                if trouble == "flood":
                    flooder.start()
            if victim is not None and number == rounds // 4 + round(FROZEN_S / fleet.period_s):
                victim.send_signal(signal.SIGCONT)
            began = time.monotonic()
            for i, payload in fleet.round(number, time.time_ns()):
                publishers[i].put(payload)
            put_longest = max(put_longest, time.monotonic() - began)
            due += fleet.period_s
            time.sleep(max(0.0, due - time.monotonic()))
        stop.set()
        if flooder.ident:
            flooder.join()
        time.sleep(2.0)
        return _judged(healthy.heard, rounds, begun_ns, fleet, _said(endpoint, trouble))


def _said(endpoint: str, trouble: str) -> str:
    if trouble != "flood":
        return ""
    with Client((endpoint,), ward=WARD) as client:
        statuses = client.statuses(wait_s=1.5)
        flooded = {device: n for device, s in statuses.items() if (n := s.events.get("messages flooded", 0))}
        dropped = statuses[name(DEVICES - 1)].dropped if name(DEVICES - 1) in statuses else {}
    return f"flooded {flooded}, dropped {dropped}"


def _judged(heard: list[tuple[int, str, bytes]], rounds: int, begun_ns: int, fleet: Fleet, said: str) -> Suffered:
    innocent = {name(i) for i in range(fleet.n - 1)}
    latency, hole_s, samples = list[float](), 0.0, dict[str, set[int]]()
    before = 0
    for now_ns, _, payload in heard:
        batch = columns.CorrectedBatch.FromString(payload)
        if batch.device not in innocent:
            continue
        samples.setdefault(batch.device, set()).update(range(batch.sequence, batch.sequence + len(batch.ticks) // 8))
        if now_ns < begun_ns:
            before = now_ns
            continue
        latency.append((now_ns - batch.start_time_ns) * 1e-9)
        hole_s = max(hole_s, (now_ns - before) * 1e-9)
        before = now_ns
    holes = 0.0
    times: dict[str, int] = {}
    for now_ns, key, _ in heard:
        if now_ns >= begun_ns and keys.parse(key).device in innocent:
            holes = max(holes, (now_ns - times.get(key, begun_ns)) * 1e-9)
            times[key] = now_ns
    lost = len(innocent) * rounds * fleet.batch - sum(map(len, samples.values()))
    p50, p99 = np.percentile(latency, (50, 99))
    return Suffered(float(p50), float(p99), max(latency), hole_s, holes, lost, said)


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
