"""A router that sheds nothing, as a process that is killed: `python -m tests.bench.router ENDPOINT`; says `up`."""

import sys
import threading

from bridge.bus.embedded_router import Router

if __name__ == "__main__":
    with Router([sys.argv[1]]):
        print("up", flush=True)
        threading.Event().wait()
