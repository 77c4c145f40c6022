"""Shared parts of a running estimator, which its modules pass to each other."""

from collections.abc import Callable
from dataclasses import dataclass

from bridge.bus.contract import Bus
from bridge.wire.refusal import Tally
from estimator.config.schema import Estimator
from estimator.service.cluster import Cluster
from estimator.service.device_roster import DeviceRoster
from estimator.service.store_access import StoreAccess


@dataclass(frozen=True, slots=True)
class Parts:
    """Shared parts of one running estimator.

    now_ns: the host's clock, ns since the Unix epoch. counts: the ward's counts of refused and lost messages. devices:
    the roster. record: access to the store.
    troubles: event counts of the whole estimator, reported in every device's status.
    """

    ward: str
    settings: Estimator
    bus: Bus
    now_ns: Callable[[], int]
    counts: Tally
    devices: DeviceRoster
    cluster: Cluster
    record: StoreAccess
    troubles: dict[str, int]
