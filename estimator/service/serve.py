"""`truerate estimator serve`: sessions on the bus, signals, and the wait for a router."""

import logging
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from bridge.bus.contract import Bus, BusError
from bridge.bus.zenoh_bus import ZenohBus
from estimator.config import Ward
from estimator.service.shell import Service
from estimator.service.store import Store

log = logging.getLogger(__name__)


def run(ward: Ward) -> None:
    """Serve until SIGINT or SIGTERM; raises StoreError. A missing router is waited for."""
    if ward.estimator is None:
        raise ValueError("no estimator is configured")
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with ExitStack() as stack:
        store = Store(ward.estimator.store)
        stack.callback(store.close)
        data, control = (connect(ward.bus.connect, stop) for _ in range(2))
        if data is None or control is None:
            return
        stack.enter_context(data)
        stack.enter_context(control)
        Service(ward.ward, ward.estimator, data, control, store).run(stop)


def connect(
    endpoints: Sequence[str], stop: threading.Event, open_bus: Callable[[Sequence[str]], Bus] = ZenohBus
) -> Bus | None:
    """A session, however long its router takes to come; None when stopped meanwhile."""
    told = False
    while not stop.is_set():
        try:
            return open_bus(endpoints)
        except BusError as error:
            if not told:
                log.warning("%s; waiting for it", error)
                told = True
            stop.wait(0.2)
    return None
