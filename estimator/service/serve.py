"""Command `truerate estimator serve`: starts the estimator with its store and signal handlers."""

import gc
import logging
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from functools import partial
from importlib import import_module

from bridge.bucket.bucket import Bucket
from bridge.bucket.mirror import Mirror
from bridge.bus.access_self_test import self_test
from bridge.bus.startup import claim_id, wait_for_router
from bridge.config.schema import listening
from bridge.config.ward_file import WardFile
from bridge.pki.member import Role
from bridge.runtime.health_server import HealthServer
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import stopped_by_signal
from estimator.alerts.sender import Sender
from estimator.config.alerts import Alerts
from estimator.config.schema import Ward
from estimator.database import Backups, Database
from estimator.database.backups import copies_of, name_of_copy
from estimator.database.owner import owned
from estimator.kernels.compiled import ready
from estimator.service.health import ServiceHealth

log = logging.getLogger(__name__)

#: allocations between garbage collections: a round makes thousands of objects, none of them in a cycle
_CYCLES = 50_000
#: settings of the ward's file that take effect in a running estimator; those of a device at its next boot or calibration
LIVE = (
    "devices.enrolled",
    *(f"estimator.{name}" for name in ("method", "model", "models", "horizontal_turns", "warming_s")),
    *(f"alerts.{name}" for name in Alerts.__struct_fields__),
)
#: modules that trackers and calibrations need when they start
_LEARNING = ("filterpy.kalman", "scipy.linalg", "scipy.optimize", "scipy.spatial.transform", "scipy.special")


def run(ward: Ward, file: WardFile[Ward] | None = None) -> None:
    """Run the estimator of a ward until SIGINT or SIGTERM; waits for a missing router.

    file: the ward file, which may change. Raises ValueError if no estimator is configured; StoreError if another
    estimator uses the store or the file is no store; BusError if an estimator of this id runs already.
    """
    if ward.estimator is None:
        raise ValueError("the ward file has no table [estimator]: add it")
    kernels = _load()
    routers = ward.bus.routers_as(Role.ESTIMATOR, name=ward.estimator.id)
    vitals = ServiceHealth(expects=bool(ward.bridge and ward.bridge.devices), routers=routers)
    with stopped_by_signal() as stop, ExitStack() as stack:
        if ward.estimator.health:
            stack.enter_context(HealthServer(listening(ward.estimator.health), vitals.asked))
        stack.enter_context(owned(ward.estimator.store))
        stack.enter_context(supervised(vitals.sick))
        database = Database(ward.estimator.store, patient=True, alone=True, backups=ward.estimator.backups)
        stack.callback(database.close)
        bus = wait_for_router(routers, stop, patient=True)
        if bus is None:
            return
        stack.enter_context(bus)
        for words in self_test(bus, routers, ward.ward):
            log.error("%s", words)
        if file is not None:
            stack.enter_context(closing(file.answer(bus, routers, Role.ESTIMATOR, ward.estimator.id)))
        others = set[str]()
        load = partial(import_module, "estimator.service.run_loop")  # while others answer
        stack.enter_context(closing(claim_id(bus, ward.ward, "estimator", ward.estimator.id, others.add, load)))
        kernels.result()
        from estimator.service.run_loop import Service  # noqa: PLC0415 - loaded above
        from estimator.service.store import Store  # noqa: PLC0415 - as above
        from estimator.service.store_writer import StoreWriter  # noqa: PLC0415 - as above

        out = Sender(ward.ward, ward.alerts)
        stack.callback(out.close)
        mirror = copied(ward)
        if mirror is not None:
            stack.callback(mirror.close)
        clerk = StoreWriter(database)
        stack.callback(clerk.close)
        store = Store(database)
        Service(
            ward.ward,
            ward.estimator,
            bus,
            store,
            vitals=vitals,
            clerk=clerk,
            enrolment=ward.devices,
            peers=frozenset(others),
            file=file,
            alerts=ward.alerts,
            send=out.put,
            sends=out.use,
            copies_fail=lambda: mirror is not None and mirror.fault is not None,
        ).run(stop)


def copied(ward: Ward) -> Mirror | None:
    """Start copying the estimator's backups to the bucket of [s3].

    Returns the running copier; None if the ward file asks for no copies. Raises ConfigError for a missing package or
    access key.
    """
    if ward.s3 is None or not ward.s3.backups or ward.estimator is None:
        return None
    backups = Backups.of(ward.estimator.store, ward.estimator.backups)
    return Mirror(Bucket(ward.s3, ward.ward), copies_of(ward.estimator.id), backups.newest_first, name_of_copy)


def _load() -> Future[None]:
    """Load the compiled kernels on a thread, then the modules for bias tracking; returns the kernels' future."""
    gc.set_threshold(_CYCLES)
    loader = ThreadPoolExecutor(1, "load")
    kernels = loader.submit(ready)
    for part in _LEARNING:
        loader.submit(import_module, part)
    loader.shutdown(wait=False)
    return kernels
