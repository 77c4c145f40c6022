"""`truerate estimator serve`: sessions on the bus, signals, and the wait for a router."""

import gc
import logging
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from importlib import import_module

from bridge.bus.contract import Bus, BusError, Declared
from bridge.bus.self_test import self_test
from bridge.config import listening
from bridge.health import Health
from bridge.pki.member import Role
from bridge.process import alone, connected, stopped_by_signal
from estimator.config import Ward
from estimator.database import Database, StoreError
from estimator.database.owner import owned
from estimator.loops.compiled import ready
from estimator.service.vitals import Vitals

log = logging.getLogger(__name__)

#: objects that come and stay within a second, of which Python's search for cycles is begun: more than a device needs
_LEAST, _OF_EACH = 5_000, 100
#: how often it is looked whether all are to be looked through, s, and how many times more they are then
_LOOK_S, _MORE = 600, 1.25
#: scipy, which calibrations need, is loaded so long after the start, s: first all that waits is corrected
_REST_S = 3.0
#: how long the thread that does may keep others waiting meanwhile, s: each message that is said lets it in, and at Python's own
#: 5 ms for each a ward waited for over a second, so that other estimators took this one for hanging
_TURN_S = 2e-4


def run(ward: Ward) -> None:
    """Serve until SIGINT or SIGTERM; a missing router is waited for.

    Raises StoreError where the store is not ours to use, and BusError where an estimator of this id runs already.
    """
    if ward.estimator is None:
        raise ValueError("no estimator is configured")
    vitals = Vitals(expects=bool(ward.bridge and ward.bridge.devices), routers=ward.bus.routers)
    with stopped_by_signal() as stop, ExitStack() as stack:
        if ward.estimator.health:
            try:
                stack.enter_context(Health(listening(ward.estimator.health), vitals.asked))
            except OSError:
                _look_for_another(ward, ward.estimator.id, stop)  # which would be why
                raise
        routers = ward.bus.routers_as(Role.ESTIMATOR, name=ward.estimator.id)
        try:
            stack.enter_context(owned(ward.estimator.store))
        except StoreError:
            _look_for_another(ward, ward.estimator.id, stop)  # which would be why
            stack.enter_context(owned(ward.estimator.store))  # it may just have been ending
        database = Database(ward.estimator.store, patient=True)
        stack.callback(database.close)
        data, control = (connected(routers, stop, patient=True) for _ in range(2))
        if data is None or control is None:
            return
        stack.enter_context(data)
        stack.enter_context(control)
        for words in self_test(control, routers, ward.ward):
            log.error("%s", words)
        others = set[str]()
        stack.enter_context(closing(look_round(control, ward.ward, ward.estimator.id, _load, others.add)))
        from estimator.service.clerk import Clerk  # noqa: PLC0415 - see _load
        from estimator.service.shell import Service  # noqa: PLC0415
        from estimator.service.store import Store  # noqa: PLC0415

        clerk = Clerk(database)
        stack.callback(clerk.close)
        store = Store(database)
        rest = threading.Timer(_REST_S, load_rest)
        rest.daemon = True
        stack.callback(rest.cancel)
        rest.start()
        Service(
            ward.ward,
            ward.estimator,
            data,
            control,
            store,
            vitals=vitals,
            clerk=clerk,
            enrolment=ward.devices,
            peers=frozenset(others),
            tend=Cycles().tend,
        ).run(stop)


def _look_for_another(ward: Ward, own: str, stop: threading.Event) -> None:
    """Raise BusError where an estimator of our own id is there already; a router that cannot be asked is no news now."""
    try:
        control = connected(ward.bus.routers, stop, patient=False)
    except BusError:
        return
    if control is not None:
        with control:
            look_round(control, ward.ward, own).close()


def _load() -> None:
    """The mathematics: loading it takes longer than looking round, and a ward waits for an estimator that starts again.

    Next to nothing of it is ever garbage, which Python would look for in all of it again and again: a fifth of the start.
    """
    gc.disable()
    try:
        import_module("estimator.service.shell")
        ready()
    finally:
        gc.freeze()
        gc.enable()


def load_rest() -> None:
    """What is imported when it is used first: loading it would hold up all devices when the first of them is calibrated."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(_TURN_S)
    try:
        for part in ("linalg", "optimize", "spatial.transform", "special"):
            import_module(f"scipy.{part}")
    finally:
        sys.setswitchinterval(before_s)


class Cycles:
    """Python's search for cycles, kept from holding up a ward: for a thousand devices it takes half a second, and finds none.

    What has lived for a second is left out of it, which costs nothing; all there is of it is looked through when it has become
    more by a quarter, as Python does by itself.
    """

    def __init__(self) -> None:
        self._seconds = 0
        gc.freeze()
        self._searched = gc.get_freeze_count()
        self.tend(0)

    def tend(self, devices: int) -> None:
        """Once a second: of so many devices so much comes within one that it is no sign of anything."""
        gc.set_threshold(max(_LEAST, _OF_EACH * devices), 0, 1_000)
        gc.freeze()
        self._seconds += 1
        if self._seconds % _LOOK_S == 0 and gc.get_freeze_count() > _MORE * self._searched:
            gc.unfreeze()
            gc.collect()
            gc.freeze()
            self._searched = gc.get_freeze_count()


def look_round(
    control: Bus,
    ward: str,
    own: str,
    meanwhile: Callable[[], None] = lambda: None,
    another: Callable[[str], object] = lambda _: None,
) -> Declared:
    """Watch the other estimators of the ward, another(id) is told of each; raises BusError when one has our own id."""
    return alone(control, ward, "estimator", own, another, meanwhile)
