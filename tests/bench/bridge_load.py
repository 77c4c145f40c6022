"""What many devices cost a bridge, and how long a sample is under way from the device to a subscriber. `make bench-bridge`.

Senders, router and bridge are processes of their own; this one subscribes. CPU is the bridge's, user and system, in percent
of a core; a sample's way is from the write of its last byte to the arrival of its batch at a subscriber.
"""

import argparse
import contextlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.demo.ward import free_port, listens

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_WARM_UP_S = 3.0
_GOALS = {"pty": "≤ 10 % for 20", "tcp": "≤ 60 % for 200", "udp": "≤ 60 % for 200"}


class Run(NamedTuple):
    """One measurement: percent of a core, ms under way (median, 99 of 100), samples heard and missing."""

    percent: float
    median_ms: float
    p99_ms: float
    samples: int
    missing: int
    threads: int


@contextlib.contextmanager
def process(*words: str, log: Path, talks: bool = False) -> Iterator[subprocess.Popen[bytes]]:
    """One of ours, ended at the end; talks: with pipes to it and from it, and it ends when the first is closed."""
    with log.open("ab") as out:
        pipe_in, pipe_out = (subprocess.PIPE, subprocess.PIPE) if talks else (subprocess.DEVNULL, out.fileno())
        started = subprocess.Popen([sys.executable, "-m", *words], stdin=pipe_in, stdout=pipe_out, stderr=out)
    try:
        yield started
    finally:
        for pipe in (started.stdin, started.stdout):
            if pipe is not None:
                pipe.close()
        if not talks:
            started.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(10)
        started.kill()
        started.wait()


def measure(kind: str, n: int, per_packet: int, batch_ms: float, seconds: float, folder: Path) -> Run:
    """One run of one load."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with contextlib.ExitStack() as stack:
        senders = stack.enter_context(
            process("tests.bench.senders", kind, str(n), str(per_packet), log=folder / "senders.log", talks=True)
        )
        assert senders.stdout is not None
        ports = json.loads(senders.stdout.readline())
        config = folder / "ward.toml"
        config.write_text(_config(endpoint, ports, batch_ms))
        stack.enter_context(process("estimator.cli.main", "router", "--listen", endpoint, log=folder / "router.log"))
        listens(endpoint, 20.0)
        bus = stack.enter_context(ZenohBus([endpoint], open_timeout_s=20.0))
        raw = bus.subscribe(keys.pattern("bench", "raw"))
        bridge = stack.enter_context(
            process("estimator.cli.main", "bridge", "run", str(config), log=folder / "bridge.log")
        )
        end = time.monotonic() + _WARM_UP_S + 0.01 * n
        heard: set[str] = set()
        while time.monotonic() < end or len(heard) < n:
            heard |= {key for key, _ in raw.drain(10_000, 0.1)}
            if time.monotonic() > end + 30 or bridge.poll() is not None:
                raise RuntimeError(
                    f"only {len(heard)} of {n} devices came: {(folder / 'bridge.log').read_text()[-2000:]}"
                )
        cpu_s, begun = _cpu_s(bridge.pid), time.monotonic()
        messages: list[tuple[str, bytes, int]] = []
        while time.monotonic() < begun + seconds:
            for key, payload in raw.drain(10_000, 0.01):
                messages.append((key, payload, time.time_ns()))
        percent = 100 * (_cpu_s(bridge.pid) - cpu_s) / (time.monotonic() - begun)
        threads = len(list(Path(f"/proc/{bridge.pid}/task").iterdir()))
    return _judged(messages, percent, threads, per_packet)


def _judged(messages: list[tuple[str, bytes, int]], percent: float, threads: int, per_packet: int) -> Run:
    under_way_us, last, missing, samples = [], dict[str, int](), 0, 0
    for key, payload, heard_ns in messages:
        batch = codec.decode_samples(key, payload)
        n = len(batch)
        samples += n
        missing += batch.sequence - last.get(key, batch.sequence)
        last[key] = batch.sequence + n
        ends = (batch.sequence + np.arange(n)) % per_packet == per_packet - 1  # these were written last
        under_way_us.append((heard_ns // 1000 - batch.ticks[ends].astype(np.int64)) % 2**32)
    way_ms = np.concatenate(under_way_us) * 1e-3
    return Run(percent, float(np.median(way_ms)), float(np.percentile(way_ms, 99)), samples, missing, threads)


def _config(endpoint: str, ports: list[str], batch_ms: float) -> str:
    devices = "".join(
        f'[[bridge.devices]]\nid = "d{i}"\ndriver = "native"\nport = "{port}"\n' for i, port in enumerate(ports)
    )
    return f'ward = "bench"\n[bus]\nconnect = ["{endpoint}"]\n[bridge]\nid = "b"\nbatch_ms = {batch_ms}\n{devices}'


def _cpu_s(pid: int) -> float:
    """As os.times of the process itself: user and system, all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * _TICK_S


def main() -> None:
    """Print a table of medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "loads", nargs="*", default=["pty:20", "tcp:200", "udp:200"], help="kind:devices[:samples a packet]"
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--batch-ms", type=float, default=50.0)
    given = parser.parse_args()
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, 8192), most))
    table = Table(
        title=f"104 Hz, batches of {given.batch_ms:g} ms, medians of {given.runs} runs of {given.seconds:g} s"
    )
    for heading in ("devices", "CPU %", "all runs", "goal", "under way, median", "99 of 100", "missing", "threads"):
        table.add_column(heading)
    console = Console(width=130)
    for load in given.loads:
        kind, n, per_packet = [*load.split(":"), "2"][:3]
        runs = []
        for _ in range(given.runs):
            with tempfile.TemporaryDirectory() as folder:
                runs.append(measure(kind, int(n), int(per_packet), given.batch_ms, given.seconds, Path(folder)))
        percents = [run.percent for run in runs]
        table.add_row(
            f"{n} {kind}, {per_packet} a packet",
            f"{statistics.median(percents):.1f}",
            " ".join(f"{percent:.1f}" for percent in percents),
            _GOALS[kind],
            f"{statistics.median(run.median_ms for run in runs):.0f} ms",
            f"{statistics.median(run.p99_ms for run in runs):.0f} ms",
            f"{sum(run.missing for run in runs)} of {sum(run.samples for run in runs)}",
            str(runs[0].threads),
        )
    console.print(table)


if __name__ == "__main__":
    main()
