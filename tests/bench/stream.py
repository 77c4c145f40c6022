"""Twenty streams over WebSocket, each cut twice and resumed: every sample once? And the dashboard's share of a core."""

import argparse
import asyncio
import json
import sys
from contextlib import suppress
from urllib.parse import urlencode

from rich.console import Console
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from tests.bench.dashboard import DEVICES, idle, served
from tests.bench.programs import cpu_s
from tests.bridge.recording.crowd import RATE_HZ

STREAMS, SECONDS, CUTS, AWAY_S = 20, 60.0, 2, 1.5
#: the goal: share of a core of the dashboard, all in all
MOST = 0.20


async def follow(web: str, device: str, seconds: float) -> list[int]:
    """Numbers of the samples of a device, over `CUTS` cuts; the connection is torn, not closed."""
    found: list[int] = []
    after = ""
    for part in range(CUTS + 1):
        asked = {"device": device, **({"after": after} if after else {})}
        async with connect(f"ws://{web}/api/v1/stream?{urlencode(asked)}", close_timeout=0.1) as socket:
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


async def followed(web: str, seconds: float) -> list[list[int]]:
    """The same of all streams."""
    return await asyncio.gather(*(follow(web, f"device-{n:03d}", seconds) for n in range(STREAMS)))


def main() -> int:
    """Print what came and what it cost; 1 when a sample was lost or came twice, or the share is above the goal."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    given = parser.parse_args()
    with served() as (web, pid):
        alone, used_s = idle(pid), cpu_s(pid)
        streams = asyncio.run(followed(web, given.seconds))
        used = (cpu_s(pid) - used_s) / (given.seconds + CUTS * AWAY_S)
    missing = sum(numbers[-1] - numbers[0] + 1 - len(set(numbers)) for numbers in streams)
    twice = sum(len(numbers) - len(set(numbers)) for numbers in streams)
    Console().print(
        f"{STREAMS} streams of {RATE_HZ:g} Hz for {given.seconds:g} s, each cut {CUTS} times for {AWAY_S:g} s:"
        f" {sum(map(len, streams)):,} samples, {missing} missing, {twice} twice;"
        f" dashboard {used:.1%} of a core, {alone:.1%} for the {DEVICES} devices without streams",
        soft_wrap=True,
    )
    return int(bool(missing or twice) or used > MOST)


if __name__ == "__main__":
    sys.exit(main())
