"""Schema of the estimator's part of a ward's file: the table [estimator], and the whole file with all tables typed."""

import os
from pathlib import Path

from msgspec import Struct

from bridge.config import schema
from bridge.toml.loader import ConfigError, nearest
from estimator.calibration.method_names import BY_HAND, DEFAULT
from estimator.config.alerts import Alerts
from estimator.config.dashboard import Dashboard
from estimator.noise.device_model import load_model


class Estimator(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the estimator: its id, its store, its calibration method and the noise models of devices.

    A comment at each field states its meaning and unit. Raises ValueError for an invalid setting.
    """

    #: name of the estimator in keys and certificates
    id: str
    #: SQLite file; relative to the folder the estimator is started in
    store: str = "truerate.sqlite3"
    #: folder of the daily backups, best on another disk; default: `backups` beside the store
    backups: str = ""
    #: calibration method: `closure`, `turn360`, `transitions` or `accel_aided`
    method: str = DEFAULT
    #: device model: a name from configs/devices, or the path of such a file; empty: as the device states, else `generic`
    model: str = ""
    #: models of devices that differ, by device id: `{ chest = "lsm9ds1" }`
    models: dict[str, str] = {}
    #: require turns about horizontal axes, so that an accelerometer can check each angle
    horizontal_turns: bool = False
    #: estimate scale and misalignment from gravity while a device is worn, and use them once they are more certain than the
    #: calibration; the device then counts as calibrated
    learn_matrix: bool = False
    #: seconds after power-up during which readings are ignored
    warming_s: float = 1.0
    #: seconds without a sample after which a device is lost
    silence_s: float = 2.0
    #: address of /metrics, /healthz and /readyz, for example `127.0.0.1:9464`
    health: str = ""

    def __post_init__(self) -> None:
        schema.check(self.id, "id")
        if not self.store.strip() or not self.store.isprintable():
            raise ValueError(f"store is {self.store!r}; the path of a file is expected, such as 'truerate.sqlite3'")
        if os.path.isdir(self.store):  # noqa: PTH112 - who may not look there need not know
            inside = Path(self.store) / "truerate.sqlite3"
            raise ValueError(f"store is {self.store!r}, which is a folder; a file is expected, such as '{inside}'")
        if self.health:
            schema.listening(self.health)
        if self.method not in BY_HAND:
            raise ValueError(f"unknown method {self.method!r}; {nearest(self.method, BY_HAND)}")
        for device, model in (("", self.model), *self.models.items()):
            if device:
                schema.check(device, "a device in models")
            try:
                if device or model:
                    load_model(model)
            except ConfigError as error:
                raise ValueError(str(error)) from None
        if not 0 <= self.warming_s <= 3600:
            raise ValueError(f"warming_s is {self.warming_s:g}; allowed: 0 to 3600 seconds")
        if not 0.2 <= self.silence_s <= 600:
            raise ValueError(f"silence_s is {self.silence_s:g}; allowed: 0.2 to 600 seconds")


class Ward(schema.Root, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Whole ward file, with typed tables [estimator], [dashboard] and [alerts] besides those of schema.Root.

    Raises ValueError if two programs are to listen on the same address.
    """

    estimator: Estimator | None = None
    dashboard: Dashboard = Dashboard()
    alerts: Alerts = Alerts()

    def __post_init__(self) -> None:
        super().__post_init__()
        here, there = (table.health if table else "" for table in (self.estimator, self.bridge))
        if here and there and schema.clash(here, there):
            both = repr(here) if here == there else f"{here!r} and {there!r}"
            raise ValueError(f"health of bridge and estimator is {both}: give each a port of its own")
        for health in filter(None, (here, there)):
            if schema.clash(health, listen := self.dashboard.listen):
                raise ValueError(
                    f"health is {health!r} and the dashboard's listen is {listen!r}: give each a port of its own"
                )
