"""Whether the page calls a device fine of which `truerate status` says that it needs a person: a ward for an hour, with faults.

Router, bridge, estimator and dashboard are processes; the bridge simulates the devices, faster than life. Every minute a
process is stopped for some seconds. At each look `truerate status` is asked, and the page's API before and after it, so
that what changes meanwhile counts for neither.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from itertools import cycle
from pathlib import Path

from rich.console import Console

from estimator.demo.ward import Ward, listens
from tests.ward.parts import add_simulated

#: every so often, s, one of these is stopped for a while; after the bridge all devices have started anew
_EVERY_S, _FOR_S = 60.0, 10.0
_STOPPED = ("bridge", "estimator", "router")


def page(ward: Ward) -> dict[str, bool]:
    """Whether each device is fine, as the page has it; empty where the page knows that it is cut off."""
    with urllib.request.urlopen(f"http://{ward.page}/api/v1/devices", timeout=10) as answer:
        said = json.load(answer)
    return {one["id"]: not one["needs_person"] for one in said["devices"]} if said["connected"] else {}


def status(ward: Ward) -> dict[str, bool]:
    """Whether each device that it lists is fine, as `truerate status` has it; empty where nothing answers it."""
    words = [sys.executable, "-m", "estimator.cli.main", "status", "--json", "--config", str(ward.config)]
    said = subprocess.run(words, capture_output=True, check=False, timeout=60).stdout
    with suppress(json.JSONDecodeError, KeyError):
        return {one["device"]: False for one in json.loads(said)["needs"]}
    return {}


def stopped(ward: Ward) -> Iterator[str]:
    """Stop a process from time to time, and start it again; yields what was done, at each look."""
    due = time.monotonic() + _EVERY_S
    for name in cycle(_STOPPED):
        while time.monotonic() < due:
            yield ""
        ward.stop(name)
        due = time.monotonic() + _FOR_S
        yield f"{name} stopped"
        while time.monotonic() < due:
            yield ""
        ward.start(name)
        due = time.monotonic() + _EVERY_S
        yield f"{name} started"


def main() -> int:
    """Print it; 1 if the page called a device fine that was not."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--hours", type=float, default=1.0, help="of the devices' life")
    parser.add_argument("--speed", type=float, default=4.0, help="times life")
    given = parser.parse_args()
    console, names = Console(), [f"d{number:03d}" for number in range(given.devices)]
    looks = compared = needed = wrong = 0
    with tempfile.TemporaryDirectory() as folder, Ward(Path(folder), ()) as ward:
        add_simulated(ward, names, given.speed, "ward")
        ward.start("router", "estimator", "bridge", "dashboard")
        listens(f"tcp/{ward.page}", 120)
        time.sleep(5.0)
        faults, until = stopped(ward), time.monotonic() + 3600 * given.hours / given.speed
        while time.monotonic() < until:
            if fault := next(faults):
                console.print(f"{time.monotonic() - until:.0f} s: {fault}", style="dim")
            before, said, after = page(ward), status(ward), page(ward)
            looks += 1
            compared += len(before)
            needed += len(said)
            for name in said:
                if before.get(name) and after.get(name):
                    wrong += 1
                    console.print(f"{name}: the page calls it fine, and `truerate status` does not", style="red")
    console.print(
        f"{given.devices} devices, {given.hours:g} h at {given.speed:g} times life, {looks} looks: the page judged {compared} "
        f"times, {needed} times `truerate status` named one; the page called {wrong} of these fine"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
