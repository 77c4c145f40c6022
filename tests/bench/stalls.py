"""For how long a process may be held up before the others take it for gone, and how soon one that hangs is known. `make bench`.

A client and a router of their own processes are stopped (SIGSTOP) for so long, and watched by another client.
"""

import signal
import subprocess
import sys
import time
from collections.abc import Callable

from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from bridge.columns import Column, Columns
from estimator.demo.ward import free_port

STALLS_S = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 1.7, 1.9)
SETTLED_S, HANGS_S = 0.5, 5.0
ROUTER = """
import sys, threading
from bridge.bus.router import Router
with Router([sys.argv[1]]):
    print("up", flush=True)
    threading.Event().wait()
"""
CLIENT = """
import sys, threading
from bridge.bus.zenoh_bus import ZenohBus
with ZenohBus([sys.argv[1]]) as bus:
    token = bus.declare_alive("x/alive")
    print("up", flush=True)
    threading.Event().wait()
"""


def started(program: str, endpoint: str) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", program, endpoint], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def stopped(process: subprocess.Popen[str], gone: Callable[[], bool], for_s: float) -> float | None:
    """Seconds until it was taken for gone; None if it was not, in for_s and what it then takes to tell."""
    found, began = None, time.monotonic()
    process.send_signal(signal.SIGSTOP)
    while (passed := time.monotonic() - began) < for_s + SETTLED_S and found is None:
        found = passed if gone() else None
        if passed >= for_s:
            process.send_signal(signal.SIGCONT)
        time.sleep(0.005)
    process.send_signal(signal.SIGCONT)
    time.sleep(2 * SETTLED_S)  # it comes back
    return found


def main(rounds: int = 3) -> None:
    """Print a table."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = started(ROUTER, endpoint)
    client = started(CLIENT, endpoint)
    alive: dict[str, bool] = {}
    table = Columns([Column("who"), *(Column(f"{s:g} s", number=True) for s in STALLS_S), Column("hangs", number=True)])
    try:
        with ZenohBus([endpoint]) as bus:
            watch = bus.watch_alive("x/**", alive.__setitem__)
            time.sleep(SETTLED_S)
            for who, process, gone in (
                ("client", client, lambda: not alive["x/alive"]),
                ("router", router, lambda: not bus.connected),
            ):
                lost = [sum(stopped(process, gone, s) is not None for _ in range(rounds)) for s in STALLS_S]
                known = max(stopped(process, gone, HANGS_S) or HANGS_S for _ in range(rounds))
                table.add(who, *(f"{n}/{rounds}" for n in lost), f"{known:.2f} s")
            watch.close()
    finally:
        for process in (client, router):
            process.kill()
            process.communicate()
    Console(width=120).print("Taken for gone when held up for so long; and by when one that hangs is known, the worst:")
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
