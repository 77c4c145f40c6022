"""The dashboard of a busy ward: its share of a core, with fifty viewers and one that never reads."""

import argparse
import asyncio
import json
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console
from websockets.asyncio.client import connect

from estimator.demo.ward import free_port
from tests.bench.programs import CLI, cpu_s, program, router, ward_file
from tests.bridge.recording.crowd import RATE_HZ, WARD

DEVICES = 60
_WATCH = json.dumps({"watch": ["ward", "rates", "bias"]})


@contextmanager
def served() -> Iterator[tuple[str, int]]:
    """Address and process id of a dashboard, once it shows a ward whose devices all send."""
    endpoint, web = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder:
        file = ward_file(Path(folder), WARD, endpoint, f'[dashboard]\nlisten = "{web}"\n')
        with (
            router(file, endpoint),
            program("tests.bench.crowd", endpoint, str(DEVICES)),
            program(CLI, "dashboard", "--config", str(file)) as process,
        ):
            until = time.monotonic() + 60.0
            while _devices(web) < DEVICES:
                if time.monotonic() > until:
                    raise TimeoutError("the dashboard does not show the ward")
                time.sleep(0.1)
            time.sleep(3.0)
            yield web, process.pid


def _devices(web: str) -> int:
    with suppress(OSError), urllib.request.urlopen(f"http://{web}/api/v1/devices", timeout=2) as answer:
        return int(json.load(answer)["of"])
    return 0


def idle(pid: int, seconds: float = 10.0) -> float:
    """Share of a core that a process takes while nothing is asked of it."""
    before = cpu_s(pid)
    time.sleep(seconds)
    return (cpu_s(pid) - before) / seconds


async def view(url: str, seconds: float) -> float:
    """Frames a second that one viewer gets who reads all."""
    frames = 0
    async with connect(url, max_size=None) as socket:
        await socket.send(_WATCH)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for _ in socket:
                    frames += 1
    return frames / seconds


async def asleep(url: str, seconds: float) -> None:
    """One that asks for everything and reads nothing."""
    async with connect(url, max_size=None, max_queue=1) as socket:
        await socket.send(_WATCH)
        socket.transport.pause_reading()
        await asyncio.sleep(seconds)
        socket.transport.abort()


async def viewed(web: str, viewers: int, seconds: float) -> list[float]:
    """Frames a second of each of so many viewers, beside one that never reads."""
    url = f"ws://{web}/live"
    _, *found = await asyncio.gather(asleep(url, seconds), *(view(url, seconds) for _ in range(viewers)))
    return [rate for rate in found if rate is not None]


def main() -> int:
    """Print what it costs; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--viewers", type=int, default=50)
    given = parser.parse_args()
    console = Console()
    with served() as (web, pid):
        console.print(f"{DEVICES} devices at {RATE_HZ:g} Hz; nobody looks: {idle(pid, given.seconds):.1%} of a core")
        for viewers in (1, given.viewers):
            before = cpu_s(pid)
            frames = asyncio.run(viewed(web, viewers, given.seconds))
            console.print(
                f"{viewers} viewers and one that never reads: {min(frames):.1f} to {max(frames):.1f} frames/s each;"
                f" server {(cpu_s(pid) - before) / given.seconds:.1%} of a core"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
