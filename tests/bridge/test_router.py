"""The threads of a router: enough that one reader who is cut off cannot hold them all."""

import os
import subprocess
import sys

import pytest

from bridge.bus.zenoh_bus import ZenohBus
from tests.bridge.test_zenoh_bus import free_endpoint

_ROUTER = """
import os, sys
from pathlib import Path
from bridge.bus.router import Router
with Router([sys.argv[1]]):
    print(os.environ.get("ZENOH_RUNTIME"), flush=True)
    sys.stdin.readline()
    print(sum(task.read_text().startswith("rx-") for task in Path("/proc/self/task").glob("*/comm")))
"""


@pytest.mark.parametrize("set_by_hand", ["", "(rx: (worker_threads: 3))"])
def test_a_router_has_threads_enough_and_what_is_set_by_hand_holds(set_by_hand: str) -> None:
    endpoint = free_endpoint()
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    if set_by_hand:
        environment["ZENOH_RUNTIME"] = set_by_hand
    router = subprocess.Popen(
        [sys.executable, "-c", _ROUTER, endpoint],
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
    assert int(number) in ((2, 3) if set_by_hand else (31, 32)), "zenoh leaves the first without a number, or not"
