"""Orderly stop of a process on the signals SIGTERM, SIGINT and SIGHUP."""

import contextlib
import logging
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

_log = logging.getLogger(__name__)


def asked_by() -> list[signal.Signals]:
    """Return the signals that stop this process: SIGTERM, SIGINT and, unless ignored, SIGHUP."""
    asked = [signal.SIGTERM, signal.SIGINT]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        asked.append(signal.SIGHUP)
    return asked


@contextlib.contextmanager
def stopped_by_signal() -> Iterator[threading.Event]:
    """Provide an event that SIGTERM, SIGINT or SIGHUP sets, during a `with` block. A second signal kills the program.

    Use in the main thread only. Under nohup, SIGHUP stays ignored.
    """
    stop = threading.Event()

    def ask_to_stop(number: int, _: FrameType | None) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, ask_to_stop) for number in asked_by()}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
