"""`truerate estimator serve`: sessions on the bus, signals, and the wait for a router."""

import logging
import time
from contextlib import ExitStack, closing

from bridge.bus.contract import Bus, BusError, Declared
from bridge.config import listening
from bridge.health import Health
from bridge.process import connected, stopped_by_signal
from bridge.wire import keys
from bridge.wire.refusal import Refusal
from estimator.config import Ward
from estimator.service.shell import Service
from estimator.service.store import Store
from estimator.service.vitals import Vitals

log = logging.getLogger(__name__)

#: how long others are looked for at the start; how long one of our own name that was killed may still seem alive
LOOK_S, GONE_S = 0.5, 3.0


def run(ward: Ward) -> None:
    """Serve until SIGINT or SIGTERM; a missing router is waited for.

    Raises StoreError where the store is not ours to use, and BusError where an estimator of this id runs already.
    """
    if ward.estimator is None:
        raise ValueError("no estimator is configured")
    vitals = Vitals(expects=bool(ward.bridge and ward.bridge.devices))
    with stopped_by_signal() as stop, ExitStack() as stack:
        if ward.estimator.health:
            stack.enter_context(Health(listening(ward.estimator.health), vitals.asked))
        store = Store(ward.estimator.store, patient=True)
        stack.callback(store.close)
        data, control = (connected(ward.bus.connect, stop, patient=True) for _ in range(2))
        if data is None or control is None:
            return
        stack.enter_context(data)
        stack.enter_context(control)
        stack.enter_context(closing(look_round(control, ward.ward, ward.estimator.id)))
        Service(ward.ward, ward.estimator, data, control, store, vitals=vitals).run(stop)


def look_round(control: Bus, ward: str, own: str) -> Declared:
    """Watch the other estimators of the ward, and warn of each; raises BusError when one of them has our own id."""
    there: dict[str, bool] = {}

    def on_change(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        try:
            name = keys.parse(key).ids["estimator"]
        except Refusal:
            return
        there[name] = alive
        if alive and name != own:
            log.warning(
                "estimator %s serves ward %s too: devices will be corrected twice; stop one of them", name, ward
            )

    watch = control.watch_alive(keys.pattern(ward, "alive/estimator"), on_change)
    time.sleep(LOOK_S)
    deadline = time.monotonic() + GONE_S
    while there.get(own, False):
        if time.monotonic() >= deadline:
            watch.close()
            raise BusError(f"estimator {own} serves ward {ward} already; stop it, or give this one another id")
        time.sleep(0.05)
    return watch
