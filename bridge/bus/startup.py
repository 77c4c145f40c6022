"""Start-up on the bus: wait for a router, and refuse to start beside another program with the same id."""

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


#: how long others are looked for at the start; how long one of our own name that was killed may still seem alive
_LOOK_S, _GONE_S = 0.5, 3.0


def claim_id(
    bus: Bus,
    ward: str,
    kind: str,
    own: str,
    another: Callable[[str], object] = lambda _: None,
    meanwhile: Callable[[], None] = lambda: None,
) -> Declared:
    """Watch the others of a kind, `bridge` or `estimator`, in a ward; another(id) is told of each.

    It takes a while to hear of them: time for meanwhile().

    Raises BusError when one of them has our own id, and is not just one that was killed and may still seem alive.
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
            raise BusError(f"{kind} {own} serves ward {ward} already; stop it, or give this one another id")
        time.sleep(0.05)
    return watch
