"""What grows in a dashboard: Python's objects, what malloc has given out, and what the process holds. `make bench`.

Its statuses come ten times as fast as on a ward, so that what is kept of each device is full within two minutes, and its viewers
go from page to page. What is given out must then stay as it is; what the process holds beyond that is malloc's.
"""

import argparse
import asyncio
import ctypes
import gc
import json
import random
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.console import Console

from estimator.cli import main as cli
from estimator.demo.ward import free_port, listens
from tests.bench.dashboard import CLI, DEVICES, NAMES, memory_mb, process, view, ward_file

_HURRY, _LOOK_S = 10.0, 15.0
_VIEWERS, _STAYS_S = 6, (1.0, 8.0)


_NAMED = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")


class _Given(ctypes.Structure):
    """glibc's `struct mallinfo2`."""

    _fields_ = tuple((name, ctypes.c_size_t) for name in _NAMED)


def inside(told: Path, arguments: list[str]) -> None:
    """Be a dashboard that writes down what it has, again and again."""
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = _Given

    def look() -> None:
        with told.open("w", buffering=1) as file:
            while True:
                time.sleep(_LOOK_S)
                gc.collect()
                given = libc.mallinfo2()
                row = {
                    "objects": len(gc.get_objects()),
                    "blocks": sys.getallocatedblocks(),
                    "given_mb": (given.uordblks + given.hblkhd) / 1e6,
                    "free_mb": given.fordblks / 1e6,
                }
                file.write(json.dumps(row) + "\n")

    threading.Thread(target=look, daemon=True).start()
    sys.argv = ["truerate", *arguments]
    sys.exit(cli())


def wander(url: str, seconds: float) -> None:
    """Viewers that look at the ward, a device or a guide for a while, and then at something else."""
    kinds = (("ward", "rates", "bias"), ("device/{}", "trace/{}", "trail/{}"), ("guide/{}",), ("ward@zh", "rates"))

    async def one() -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            topics = [topic.format(random.choice(NAMES)) for topic in random.choice(kinds)]
            with suppress(OSError):  # on a machine with too much to do it is not answered in time
                await view(url, random.uniform(*_STAYS_S), [], topics)

    async def all_of_them() -> None:
        await asyncio.gather(*(one() for _ in range(_VIEWERS)))

    asyncio.run(all_of_them())


def main() -> int:
    """Print it over some minutes, and its slope over the last two thirds; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--inside", nargs=2, metavar=("TOLD", "CONFIG"))
    parser.add_argument("--wander")
    given = parser.parse_args()
    if given.inside:
        inside(Path(given.inside[0]), ["dashboard", "--config", given.inside[1]])
    if given.wander:
        wander(given.wander, given.minutes * 60)
        return 0
    console, me = Console(), ("-m", "tests.bench.dashboard_memory")
    router, web = f"tcp/127.0.0.1:{free_port()}", free_port()
    with tempfile.TemporaryDirectory() as folder:
        file, told = ward_file(Path(folder), router, web), Path(folder) / "told"
        with process(*CLI, "router", "--config", str(file)):
            listens(router, 20)
            with (
                process("-m", "tests.bench.dashboard", "--talk", router, "--hurry", str(_HURRY)),
                process(*me, "--inside", str(told), str(file)) as it,
            ):
                listens(f"tcp/127.0.0.1:{web}", 60)
                arguments = ["--wander", f"ws://127.0.0.1:{web}/live", "--minutes", str(given.minutes)]
                begun = subprocess.Popen([sys.executable, *me, *arguments])
                rows = _watched(console, told, it.pid, begun, given.minutes * 60)
    late = rows[len(rows) // 3 :]
    minutes = np.arange(len(late)) * _LOOK_S / 60
    slopes = {name: np.polyfit(minutes, [row[name] for row in late], 1)[0] for name in late[0]}
    said = ", ".join(f"{name} {slope:+.3g}" for name, slope in slopes.items())
    console.print(f"{DEVICES} devices, {_VIEWERS} viewers that wander; a minute of the last two thirds: {said}")
    return 0


def _watched(
    console: Console, told: Path, pid: int, begun: subprocess.Popen[bytes], seconds: float
) -> list[dict[str, float]]:
    """What it has told, and what it holds, until the viewers are gone; a last row when they are."""
    rows: list[dict[str, float]] = []
    end = time.monotonic() + seconds
    while begun.poll() is None and time.monotonic() < end + 30:
        time.sleep(_LOOK_S)
        with suppress(FileNotFoundError, IndexError):
            row = json.loads(told.read_text().splitlines()[-1]) | {"holds_mb": memory_mb(pid)}
            rows.append(row)
            console.print(
                f"{_LOOK_S * len(rows):4.0f} s: " + ", ".join(f"{name} {value:.6g}" for name, value in row.items())
            )
    begun.wait(30)
    time.sleep(2 * _LOOK_S)
    row = json.loads(told.read_text().splitlines()[-1]) | {"holds_mb": memory_mb(pid)}
    console.print("nobody looks: " + ", ".join(f"{name} {value:.6g}" for name, value in row.items()))
    return rows


if __name__ == "__main__":
    sys.exit(main())
