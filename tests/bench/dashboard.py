"""The dashboard of a busy ward: its share of a core, with fifty viewers and one that never reads."""

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from rich.console import Console
from websockets.asyncio.client import connect

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch, State
from estimator.demo.ward import free_port, listens
from tests.web.talk import about, said

WARD, DEVICES, RATE_HZ, BATCH_S = "bench", 60, 104.0, 0.05
NAMES = [f"bed-{n // 3:02d}-{('chest', 'wrist', 'ankle')[n % 3]}" for n in range(DEVICES)]
CLI = ("-m", "estimator.cli.main")
_TICK_S = 1 / os.sysconf("SC_CLK_TCK")


def talk(endpoint: str) -> None:
    """Raw and corrected rates, statuses and infos of sixty devices, as bridge and estimator send them; until stdin ends."""
    bus = ZenohBus((endpoint,), open_timeout_s=20)
    puts = {
        what: [bus.publisher(keys.build(WARD, what, **ids, device=name), cache=cache).put for name in NAMES]
        for what, cache, ids in (
            ("corrected", 512, {}), ("status", 1, {}), ("raw", 512, {"bridge": "bridge"}), ("info", 1, {"bridge": "bridge"}),
        )
    }  # fmt: skip
    alive = [bus.declare_alive(keys.build(WARD, f"alive/{kind}", **{kind: "one"})) for kind in ("bridge", "estimator")]
    begin, sent, second, next_s = time.monotonic(), 0, 0.0, 0.0
    rng = np.random.default_rng(1)
    small = np.full(3, 0.001, np.float32)
    while not _over():
        due = int((time.monotonic() - begin) * RATE_HZ)
        n, now_ns = due - sent, time.time_ns()
        if n > 0:
            ticks = (np.arange(sent, due) * 1e6 / RATE_HZ).astype(np.uint64)
            flags = np.zeros(n, np.uint32)
            for i, name in enumerate(NAMES):
                swing = np.sin(ticks[:, None] * 1e-6 + i + np.arange(3)) * (1 + i % 5)
                rate = (swing + rng.normal(0, 0.01, (n, 3))).astype(np.float32)
                raw = SampleBatch(name, 1, sent, now_ns, now_ns, 1e-6, 1.0, ticks, rate + small, None, None, flags)
                corrected = CorrectedBatch(
                    name, 1, sent, now_ns, 1e-6, 1.0, ticks, rate, flags, Quality.GOOD, small, small, small, small, "c", small
                )  # fmt: skip
                puts["raw"][i](codec.encode_samples(raw))
                puts["corrected"][i](codec.encode_corrected(corrected))
            sent = due
        if time.monotonic() - begin >= second:
            second += 1.0
            for i, name in enumerate(NAMES):
                state = State.DEGRADED if i % 20 == 7 else State.TRACKING
                puts["status"][i](codec.encode_status(said(name, state, time_ns=time.time_ns(), boot=1)))
                puts["info"][i](codec.encode_info(about(name, boot=1, time_ns=time.time_ns(), battery_percent=80.0)))
        next_s += BATCH_S
        time.sleep(max(0.0, begin + next_s - time.monotonic()))
    for one in alive:
        one.close()
    bus.close()


def _over() -> bool:
    import select

    return bool(select.select([sys.stdin], [], [], 0)[0])


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    started = subprocess.Popen([sys.executable, *arguments], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.terminate()
        started.wait(20)


def cpu_s(pid: int) -> float:
    """Seconds of a core that a process has used."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) * _TICK_S


def share(pid: int, seconds: float) -> float:
    before, begin = cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(pid) - before) / (time.monotonic() - begin)


async def view(url: str, seconds: float, counts: list[int], topics: Sequence[str] = ("ward", "rates", "bias")) -> None:
    """One viewer that reads all it gets."""
    async with connect(url, max_size=None) as socket:
        await socket.send(json.dumps({"watch": list(topics)}))
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                frames = 0
                counts.append(0)
                at = len(counts) - 1
                async for _ in socket:
                    frames += 1
                    counts[at] = frames


async def asleep(url: str, seconds: float) -> None:
    """One that asks for everything and reads nothing."""
    async with connect(url, max_size=None, max_queue=1) as socket:
        await socket.send(json.dumps({"watch": ["ward", "rates", "bias"]}))
        socket.transport.pause_reading()
        await asyncio.sleep(seconds)
        socket.transport.abort()


def crowd(url: str, viewers: int, seconds: float) -> None:
    """Print the frames a second of the slowest and the fastest viewer."""
    counts: list[int] = []

    async def all_of_them() -> None:
        await asyncio.gather(asleep(url, seconds), *(view(url, seconds, counts) for _ in range(viewers)))

    asyncio.run(all_of_them())
    print(f"{min(counts) / seconds:.1f} {max(counts) / seconds:.1f}")


def main() -> int:
    """Print what it costs; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--talk")
    parser.add_argument("--crowd")
    given = parser.parse_args()
    if given.talk:
        talk(given.talk)
        return 0
    if given.crowd:
        crowd(given.crowd, given.viewers, given.seconds)
        return 0
    console = Console()
    router, web = f"tcp/127.0.0.1:{free_port()}", free_port()
    url = f"http://127.0.0.1:{web}"
    with tempfile.TemporaryDirectory() as folder:
        file = ward_file(Path(folder), router, web)
        with process(*CLI, "router", "--config", str(file)):
            listens(router, 20)
            with (
                process("-m", "tests.bench.dashboard", "--talk", router),
                process(*CLI, "dashboard", "--config", str(file)) as it,
            ):
                _wait(url)
                console.print(
                    f"{DEVICES} devices at {RATE_HZ:g} Hz; nobody looks: {share(it.pid, given.seconds):.1%} of a core"
                )
                for viewers in (1, given.viewers):
                    console.print(viewed(it.pid, url, given.seconds, viewers))
    return 0


def ward_file(folder: Path, router: str, web: int, ward: str = WARD) -> Path:
    """The file of a ward that is talked of alone, with a dashboard."""
    file = folder / "ward.toml"
    text = f'ward = "{ward}"\n[bus]\nconnect = ["{router}"]\n[router]\nlisten = ["{router}"]\n'
    file.write_text(text + f'[dashboard]\nlisten = "127.0.0.1:{web}"\n')
    return file


def _wait(url: str) -> None:
    for _ in range(200):
        with suppress(OSError), urllib.request.urlopen(url + "/api/v1/devices", timeout=2) as answer:
            if json.load(answer)["of"] == DEVICES:
                time.sleep(3.0)
                return
        time.sleep(0.1)
    raise TimeoutError("the dashboard does not show the ward")


def viewed(pid: int, url: str, seconds: float, viewers: int) -> str:
    """What so many viewers get, and what they cost."""
    crowded = ["-m", "tests.bench.dashboard", "--crowd", url.replace("http", "ws") + "/live", "--viewers", str(viewers)]
    begun = subprocess.Popen([sys.executable, *crowded, "--seconds", str(seconds)], stdout=subprocess.PIPE)
    time.sleep(2.0)
    used = share(pid, seconds - 3.0)
    slowest, fastest = begun.communicate()[0].decode().split()
    return (
        f"{viewers} viewers and one that never reads: {slowest} to {fastest} frames/s each; server {used:.1%} of a core"
    )


if __name__ == "__main__":
    sys.exit(main())
