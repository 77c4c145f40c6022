"""Start-up on the bus: wait for a router, and refuse to start while another program uses the same id."""

import logging
import threading
import time
from collections.abc import Callable, Sequence

from bridge.bus.contract import Bus, BusError, Declared
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from bridge.wire.refusal import Refusal

_RETRY_S = 0.2

_log = logging.getLogger(__name__)


def wait_for_router(
    endpoints: Sequence[str],
    stop: threading.Event,
    *,
    patient: bool,
    open_bus: Callable[[Sequence[str]], Bus] = ZenohBus,
) -> Bus | None:
    """Open a bus session at the router endpoints by open_bus(endpoints); return None if `stop` is set first.

    patient: True retries every 0.2 s until a router answers. False raises BusError if no router answers the first try.
    """
    complained = False
    while not stop.is_set():
        try:
            return open_bus(endpoints)
        except BusError as error:
            if not patient:
                raise
            if not complained:
                _log.warning("%s; trying again until a router answers", error)
            complained = True
        stop.wait(_RETRY_S)
    return None


#: time to look for other programs at the start; time a killed program of the same id may still seem alive
_LOOK_S, _GONE_S = 0.5, 3.0


def claim_id(
    bus: Bus,
    ward: str,
    kind: str,
    own: str,
    another: Callable[[str], object] = lambda _: None,
    meanwhile: Callable[[], object] = lambda: None,
) -> Declared:
    """Check that no other running program of the same kind uses an id in a ward, and keep watching for others.

    kind: `bridge` or `estimator`. own: the id to check. another: called with the id of each other program that appears.
    meanwhile: called once, for work that can be done while the call waits for others to appear.
    Returns the handle of the watch on the other programs' liveliness tokens; the caller closes it.
    Raises BusError if a program with the same id is still alive after 3.5 s. A killed program appears alive for less
    than 3 s.
    """
    there: dict[str, bool] = {}

    def on_change(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        try:
            name = keys.parse(key).ids[kind]
        except Refusal:
            return
        there[name] = alive
        if alive and name != own:
            another(name)

    watch = bus.watch_alive(keys.pattern(ward, f"alive/{kind}"), on_change)
    looked = time.monotonic() + _LOOK_S
    meanwhile()
    time.sleep(max(0.0, looked - time.monotonic()))
    deadline = time.monotonic() + _GONE_S
    while there.get(own, False):
        if time.monotonic() >= deadline:
            watch.close()
            raise BusError(
                f"another {kind} {own} already serves ward {ward}: stop that {kind}, or give this {kind} another id"
            )
        time.sleep(0.05)
    return watch
