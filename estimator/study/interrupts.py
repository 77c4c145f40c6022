"""Ctrl-C is for who waits: it goes to every process of a terminal, and workers would each print a traceback."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ignore_interrupts() -> Iterator[None]:
    """Processes that are started meanwhile never hear of it."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
