"""Protects worker processes from Ctrl-C: a terminal sends it to every process, and each would print a traceback."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ignore_interrupts() -> Iterator[None]:
    """Context in which started processes ignore SIGINT; the present process handles it again afterwards."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
