"""The threads of a router: enough that one reader who is cut off cannot hold them all."""

import os
import subprocess
import sys

import pytest

from bridge.bus.zenoh_bus import ZenohBus
from tests.bridge.bus.test_zenoh_bus import free_endpoint

_ROUTER = """
import os, sys, time
from pathlib import Path
from bridge.bus.embedded_router import Router

def threads():  # it begins with another name
    return sum(task.read_text().startswith("rx-") for task in Path("/proc/self/task").glob("*/comm"))

with Router([sys.argv[1]]):
    print(os.environ.get("ZENOH_RUNTIME"), flush=True)
    sys.stdin.readline()
    deadline = time.monotonic() + 20.0
    while threads() < int(sys.argv[2]) and time.monotonic() < deadline:
        time.sleep(0.01)
    print(threads())
"""


@pytest.mark.parametrize(("set_by_hand", "most"), [("", 32), ("(rx: (worker_threads: 3))", 3)])
def test_a_router_has_threads_enough_and_what_is_set_by_hand_holds(set_by_hand: str, most: int) -> None:
    endpoint = free_endpoint()
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    if set_by_hand:
        environment["ZENOH_RUNTIME"] = set_by_hand
    router = subprocess.Popen(
        [sys.executable, "-c", _ROUTER, endpoint, str(most - 1)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert router.stdout is not None
    assert router.stdout.readline().strip() == (set_by_hand or "None"), "processes it starts have their own"
    bus = ZenohBus([endpoint])  # zenoh starts them with the first connection
    number, _ = router.communicate("\n")
    bus.close()
    assert most - 1 <= int(number) <= most, "the first one's number is not always told"
