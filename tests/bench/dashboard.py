"""The dashboard of a busy ward: its share of a core, redraws a second in Chromium, fifty viewers. `make bench`.

Router, dashboard and a ward that talks are processes of their own; so are Chromium and the viewers, one of which never reads.
"""

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
from typing import NamedTuple

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
CLI = ("-m", "estimator.cli")
_TICK_S = 1 / os.sysconf("SC_CLK_TCK")
_CHROMIUM = "/usr/bin/chromium"
#: beside each other, as on a ward in the morning
_TABLETS = 20
#: pages that are watched for growth, and over how many of the last minutes
_WATCHED, _SLOPE_MINUTES = ("/", "/devices/bed-01-chest"), 20


def talk(endpoint: str, hurry: float) -> None:
    """Raw and corrected rates, statuses and infos of sixty devices, as bridge and estimator send them; until stdin ends.

    hurry: how many statuses and infos of each a second.
    """
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
            second += 1 / hurry
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


def below(pid: int) -> Iterator[int]:
    """A process and all it has started."""
    yield pid
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            yield from below(int(child))


def memory_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


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


def guided(url: str, tablets: int, seconds: float) -> None:
    """Tablets that follow the guide, each of another device."""

    counts: list[int] = []
    names = [f"guide/{name}" for name in NAMES[:tablets]]

    async def ready() -> None:
        while len(counts) < tablets or min(counts) < 3:  # noqa: ASYNC110 - a bench may look
            await asyncio.sleep(0.05)
        print("ready", flush=True)

    async def all_of_them() -> None:
        await asyncio.gather(ready(), *(view(url, seconds, counts, [name]) for name in names))

    asyncio.run(all_of_them())
    print(f"{min(counts) / seconds:.1f}")


class Shown(NamedTuple):
    """A page that stands open: redraws a second, shares of a core, kilobytes loaded, seconds of the server to load it."""

    redraws: float
    browser: float
    server: float
    kilobytes: float
    opening_s: float


def shown(url: str, path: str, seconds: float, height: int, pid: int) -> Shown:
    """A page in Chromium; pid: of the server."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1920, "height": height})
        sizes: list[int] = []
        page.on("response", lambda response: sizes.append(len(response.body())))
        closed_s = cpu_s(pid)
        page.goto(url + path)
        page.wait_for_timeout(3000)
        before, served_s, drawn = _browser_s(), cpu_s(pid), page.evaluate("redraws")
        page.wait_for_timeout(seconds * 1000)
        used, server = (_browser_s() - before) / seconds, (cpu_s(pid) - served_s) / seconds
        found = page.evaluate("redraws") - drawn
        browser.close()
    return Shown(found / seconds, used, server, sum(sizes) / 1000, served_s - closed_s)


def _browser_s() -> float:
    """Seconds of a core used by Chromium's processes, which are ours by now."""
    found = 0.0
    for pid in below(os.getpid()):
        with suppress(OSError):
            if "chrom" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[0].decode():
                found += cpu_s(pid)
    return found


def main() -> int:
    """Print what it costs; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--minutes", type=float, default=0.0, help="watch the memory for so long, and nothing else")
    parser.add_argument("--guides", action="store_true", help="what a guide costs, and nothing else")
    parser.add_argument("--talk")
    parser.add_argument("--hurry", type=float, default=1.0)
    parser.add_argument("--crowd")
    parser.add_argument("--tablets", type=int, default=0)
    given = parser.parse_args()
    if given.talk:
        talk(given.talk, given.hurry)
        return 0
    if given.tablets:
        guided(given.crowd, given.tablets, given.seconds)
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
                _guides(console, it.pid, url, given.seconds)
                if given.minutes:
                    _growth(console, it.pid, url, given.minutes)
                elif not given.guides:
                    _measure(console, it.pid, url, given.seconds, given.viewers)
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


def _measure(console: Console, pid: int, url: str, seconds: float, viewers: int) -> None:
    # A usual screen, one so high that every tile is seen and drawn, and a device's page.
    for path, height in (("/", 1200), ("/", 4000), ("/devices/bed-01-chest", 1200)):
        page = shown(url, path, seconds, height, pid)
        console.print(
            f"{path}, 1920 by {height}: {page.redraws:.1f} redraws/s in Chromium ({page.browser:.0%} of a core),"
            f" {page.kilobytes:.0f} kB; server {page.server:.1%}, and {page.opening_s:.2f} s of a core for the first 3 s"
        )
    live = url.replace("http", "ws") + "/live"
    arguments = ["-m", "tests.bench.dashboard", "--crowd", live, "--viewers"]
    for n in (1, viewers):
        begun = subprocess.Popen(
            [sys.executable, *arguments, str(n), "--seconds", str(seconds)], stdout=subprocess.PIPE
        )
        time.sleep(2.0)
        used = share(pid, seconds - 3.0)
        slowest, fastest = begun.communicate()[0].decode().split()
        console.print(
            f"{n} viewers and one that never reads: {slowest} to {fastest} frames/s each; server {used:.1%} of a core"
        )


def _guides(console: Console, pid: int, url: str, seconds: float) -> None:
    """What a tablet costs that follows the guide."""
    idle = share(pid, seconds)
    arguments = [
        "--crowd",
        url.replace("http", "ws") + "/live",
        "--tablets",
        str(_TABLETS),
        "--seconds",
        str(seconds + 5),
    ]
    begun = subprocess.Popen([sys.executable, "-m", "tests.bench.dashboard", *arguments], stdout=subprocess.PIPE)
    assert begun.stdout is not None
    begun.stdout.readline()  # all of them are served
    used = share(pid, seconds)
    slowest = begun.communicate()[0].decode().strip()
    console.print(
        f"{_TABLETS} tablets, each guiding a device of its own: server {used:.1%} of a core, {idle:.1%} without; "
        f"{(used - idle) / _TABLETS:.2%} a tablet, {slowest} frames/s to the slowest"
    )


def _growth(console: Console, pid: int, url: str, minutes: float) -> None:
    """Megabytes a minute of the server, and of the JavaScript of a ward page and a device's page that stay open."""
    from playwright.sync_api import sync_playwright

    live = url.replace("http", "ws") + "/live"
    arguments = ["-m", "tests.bench.dashboard", "--crowd", live, "--viewers", "3", "--seconds", str(minutes * 60 + 60)]
    begun = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL)
    rows: list[list[float]] = []
    try:
        with sync_playwright() as p:
            flags = ["--no-sandbox", "--js-flags=--expose-gc", "--enable-precise-memory-info"]
            browser = p.chromium.launch(executable_path=_CHROMIUM, args=flags)
            pages = [browser.new_page(viewport={"width": 1280, "height": 900}) for _ in _WATCHED]
            for page, path in zip(pages, _WATCHED, strict=True):
                page.goto(url + path)
            for minute in range(round(minutes) + 1):
                heaps = [page.evaluate("gc(), performance.memory.usedJSHeapSize") / 1e6 for page in pages]
                rows.append([memory_mb(pid), *heaps])
                told = "".join(f", {path} {heap:.2f}" for path, heap in zip(_WATCHED, heaps, strict=True))
                console.print(f"minute {minute}: server {rows[-1][0]:.1f} MB; heap after collection{told} MB")
                pages[0].wait_for_timeout(60_000 if minute < round(minutes) else 0)
            browser.close()
    finally:
        begun.terminate()
        begun.wait(20)
    last = np.array(rows)[-(_SLOPE_MINUTES + 1) :]
    slopes = np.polyfit(np.arange(len(last)), last, 1)[0] if len(last) > 1 else np.full(last.shape[1], np.nan)
    said = ", ".join(f"{what} {1000 * slope:+.1f}" for what, slope in zip(("server", *_WATCHED), slopes, strict=True))
    console.print(f"growth over the last {len(last) - 1} minutes, kB a minute: {said}")


if __name__ == "__main__":
    sys.exit(main())
