"""Worker processes that ignore Ctrl-C.

A terminal sends Ctrl-C to every process, and each worker would otherwise print a traceback.
"""

import multiprocessing
import signal
from multiprocessing.pool import Pool


def started(workers: int | None) -> Pool:
    """Start worker processes, one per processor if `workers` is None; the present process still handles SIGINT."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        # Spawned, not forked: a copy of a process with threads may hang.
        return multiprocessing.get_context("spawn").Pool(workers)
    finally:
        signal.signal(signal.SIGINT, before)
