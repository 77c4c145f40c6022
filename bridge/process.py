"""What every process of ours does: it stops when it is asked to, and waits for a router that is not there yet."""

import contextlib
import logging
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

from bridge.bus.contract import Bus, BusError
from bridge.bus.zenoh_bus import ZenohBus

_RETRY_S = 0.2

_log = logging.getLogger(__name__)


@contextlib.contextmanager
def stopped_by_signal() -> Iterator[threading.Event]:
    """An event that SIGTERM and SIGINT set; a second signal ends the program the hard way. For the main thread."""
    stop = threading.Event()

    def ask_to_stop(number: int, _: FrameType | None) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, ask_to_stop) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def connected(
    endpoints: Sequence[str],
    stop: threading.Event,
    *,
    patient: bool,
    open_bus: Callable[[Sequence[str]], Bus] = ZenohBus,
) -> Bus | None:
    """A session; None if stopped first. Patient: however long its router takes to come; else raises BusError."""
    complained = False
    while not stop.is_set():
        try:
            return open_bus(endpoints)
        except BusError as error:
            if not patient:
                raise
            if not complained:
                _log.warning("%s; waiting for it", error)
            complained = True
        stop.wait(_RETRY_S)
    return None
