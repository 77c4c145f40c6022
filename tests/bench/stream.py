"""Twenty streams over WebSocket, each cut twice and resumed: every sample once? And the dashboard's share of a core."""

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlencode

from rich.console import Console
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from estimator.demo.ward import free_port, listens
from tests.bench.dashboard import CLI, DEVICES, NAMES, RATE_HZ, _wait, cpu_s, process, share, ward_file

STREAMS, SECONDS, CUTS, AWAY_S = 20, 60.0, 2, 1.5
#: the goal: share of a core of the dashboard, all in all
MOST = 0.20


async def follow(url: str, device: str, seconds: float) -> list[int]:
    """Numbers of the samples of a device, over `CUTS` cuts; the connection is torn, not closed."""
    found: list[int] = []
    after = ""
    for part in range(CUTS + 1):
        asked = {"device": device, **({"after": after} if after else {})}
        async with connect(f"{url}/api/v1/stream?{urlencode(asked)}", close_timeout=0.1) as socket:
            with suppress(TimeoutError, ConnectionClosed):
                async with asyncio.timeout(seconds / (CUTS + 1)):
                    async for text in socket:
                        one = json.loads(text)
                        after = one["after"]
                        found += range(one["sequence"], one["sequence"] + len(one["rate_rad_s"]))
            socket.transport.abort()
        if part < CUTS:
            await asyncio.sleep(AWAY_S)
    return found


def crowd(url: str, seconds: float) -> None:
    """Print the samples of all streams, and how many are missing or came twice."""

    async def all_of_them() -> list[list[int]]:
        return await asyncio.gather(*(follow(url, name, seconds) for name in NAMES[:STREAMS]))

    streams = asyncio.run(all_of_them())
    missing = sum(numbers[-1] - numbers[0] + 1 - len(set(numbers)) for numbers in streams)
    twice = sum(len(numbers) - len(set(numbers)) for numbers in streams)
    print(sum(map(len, streams)), missing, twice)


def main() -> int:
    """Print what came and what it cost; 1 when a sample was lost or came twice, or the share is above the goal."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--crowd")
    given = parser.parse_args()
    if given.crowd:
        crowd(given.crowd, given.seconds)
        return 0
    console, router, web = Console(), f"tcp/127.0.0.1:{free_port()}", free_port()
    with tempfile.TemporaryDirectory() as folder:
        file = ward_file(Path(folder), router, web)
        with process(*CLI, "router", "--config", str(file)):
            listens(router, 20)
            with (
                process("-m", "tests.bench.dashboard", "--talk", router),
                process(*CLI, "dashboard", "--config", str(file)) as it,
            ):
                _wait(f"http://127.0.0.1:{web}")
                idle = share(it.pid, 10.0)
                used_s = cpu_s(it.pid)
                words = [
                    "-m",
                    "tests.bench.stream",
                    "--crowd",
                    f"ws://127.0.0.1:{web}",
                    "--seconds",
                    f"{given.seconds}",
                ]
                told = subprocess.run([sys.executable, *words], stdout=subprocess.PIPE, check=True).stdout
                used = (cpu_s(it.pid) - used_s) / (given.seconds + CUTS * AWAY_S)
    samples, missing, twice = map(int, told.split())
    console.print(
        f"{STREAMS} streams of {RATE_HZ:g} Hz for {given.seconds:g} s, each cut {CUTS} times for {AWAY_S:g} s:"
        f" {samples:,} samples, {missing} missing, {twice} twice;"
        f" dashboard {used:.1%} of a core, {idle:.1%} for the {DEVICES} devices without streams",
        soft_wrap=True,
    )
    return int(bool(missing or twice) or used > MOST)


if __name__ == "__main__":
    sys.exit(main())
