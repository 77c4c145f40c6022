"""`truerate estimator serve`: sessions on the bus, signals, and the wait for a router."""

import logging
import threading
from contextlib import ExitStack, closing

from bridge.bus.contract import Bus, BusError, Declared
from bridge.config import listening
from bridge.health import Health
from bridge.process import alone, connected, stopped_by_signal
from estimator.config import Ward
from estimator.service.shell import Service
from estimator.service.store import Store
from estimator.service.vitals import Vitals

log = logging.getLogger(__name__)


def run(ward: Ward) -> None:
    """Serve until SIGINT or SIGTERM; a missing router is waited for.

    Raises StoreError where the store is not ours to use, and BusError where an estimator of this id runs already.
    """
    if ward.estimator is None:
        raise ValueError("no estimator is configured")
    vitals = Vitals(expects=bool(ward.bridge and ward.bridge.devices))
    with stopped_by_signal() as stop, ExitStack() as stack:
        if ward.estimator.health:
            try:
                stack.enter_context(Health(listening(ward.estimator.health), vitals.asked))
            except OSError:
                _look_for_another(ward, ward.estimator.id, stop)  # which would be why
                raise
        store = Store(ward.estimator.store, patient=True)
        stack.callback(store.close)
        data, control = (connected(ward.bus.connect, stop, patient=True) for _ in range(2))
        if data is None or control is None:
            return
        stack.enter_context(data)
        stack.enter_context(control)
        stack.enter_context(closing(look_round(control, ward.ward, ward.estimator.id)))
        Service(ward.ward, ward.estimator, data, control, store, vitals=vitals).run(stop)


def _look_for_another(ward: Ward, own: str, stop: threading.Event) -> None:
    """Raise BusError where an estimator of our own id is there already; a router that cannot be asked is no news now."""
    try:
        control = connected(ward.bus.connect, stop, patient=False)
    except BusError:
        return
    if control is not None:
        with control:
            look_round(control, ward.ward, own).close()


def look_round(control: Bus, ward: str, own: str) -> Declared:
    """Watch the other estimators of the ward, and warn of each; raises BusError when one of them has our own id."""
    return alone(
        control,
        ward,
        "estimator",
        own,
        lambda name: log.warning(
            "estimator %s serves ward %s too: devices will be corrected twice; stop one of them", name, ward
        ),
    )
