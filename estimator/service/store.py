"""Estimator store of a ward: calibrations, boots, biases, placements, alerts, and an audit of commands.

Calibrations are appended and never changed. Only the latest bias of a boot is kept. Old boots and old points of the
bias history are thinned (`retention`).
"""

import logging
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

import msgspec
import numpy as np

from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Alert, BootCause, Calibration, DeviceInfo, Placement, Verdict
from estimator.database import Database, Row, StoreError
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import differing, restore_key
from estimator.service.retention import BOOTS, POINTS, THIN
from estimator.service.store_rows import (
    Before,
    Kept,
    calibrations_in,
    kept_in,
    own_version,
    read_sentences,
    repeat_request,
    written,
)
from estimator.tracking.bias_state import OWN, BiasState
from estimator.tracking.temperature_learning import Points

__all__ = ["BOOTS", "POINTS", "REPEATED", "Before", "Store", "StoreError", "read_sentences"]

log = logging.getLogger(__name__)

#: audit verb for a boot number that another power-up had before
REPEATED = "boot number repeated"
#: order of writing, latest first, since a clock may have been wrong
_LATEST_FIRST = "number DESC"
#: number of calibrations read first: most often the latest one fits
_FEW = 8
#: on a repeated boot, only unknown properties of its device are filled in
_FILLED = ", ".join(f"{name} = iif({name}, {name}, excluded.{name})" for name in ("gyro_range", "rate_hz"))
_FILLED += "".join(f", {name} = iif({name} = '', excluded.{name}, {name})" for name in ("model", "firmware"))
_ONE_OF_BOOT = "ON CONFLICT (device, boot) DO UPDATE SET"


class Store:
    """Open store. Only the writing thread calls `add_…`, `save_…`, `repeat`, `erase` and `thin`; any thread may call the rest."""

    def __init__(self, path: Path | str | Database, *, patient: bool = False) -> None:
        self.database = path if isinstance(path, Database) else Database(path, patient=patient)

    @classmethod
    def reading(cls, path: Path | str) -> Self:
        """Open a store for reading only, whether or not an estimator uses it."""
        return cls(Database.reading(path))

    @property
    def path(self) -> str:
        """Path of the database file."""
        return self.database.path

    def close(self) -> None:
        """Close the store; all writes are on disk already."""
        self.database.close()

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def add_calibration(self, c: Calibration) -> None:
        """Append an accepted calibration; a repeat changes nothing. Raises ValueError for another verdict."""
        if c.verdict is not Verdict.ACCEPTED:
            raise ValueError(f"a calibration with verdict {c.verdict.name} is not stored")
        row: Row = {"id": c.id, "device": c.device, "boot": keys.boot_id(c.boot), "time_ns": c.time_ns}
        row |= {
            "method": c.method,
            "verdict": c.verdict.name,
            "reason": written(c.reason),
            "who": c.who,
            "version": own_version(),
        }
        row |= restore_key(c) | {"payload": codec.encode_calibration(c)}
        self.database.insert("calibrations", row, "ON CONFLICT (id) DO NOTHING")

    def add_boot(self, info: DeviceInfo, time_ns: int) -> None:
        """Add a boot; a repeat only fills in unknown properties of its device."""
        row: Row = {"device": info.device, "boot": keys.boot_id(info.boot), "time_ns": time_ns}
        row |= {"cause": BootCause(info.boot_cause).name, **restore_key(info)}
        self.database.insert("boots", row, f"{_ONE_OF_BOOT} {_FILLED}")

    def save_bias(
        self,
        device: str,
        boot: int,
        time_ns: int,
        state: BiasState,
        *,
        history: bool,
        doubted: bool = False,
        calibration: str = "",
        asked: tuple[str, str] | None = None,
        reached: tuple[int, int] | None = None,
        bridge: str = "",
        session: bytes = b"",
    ) -> None:
        """Store the latest bias of a boot for a restart; with `history` also as a point of the bias history.

        doubted, asked: see PriorKnowledge. calibration: id of the one in use. reached: sequence number and host time of
        the last sample the bias knows of, None while the device is being turned. bridge: the one the device is heard
        from. session: see DeviceSession.state.
        """
        # A restored tracker starts anew with all states except the filter's own.
        x, P = state.x[:OWN].tolist(), state.P[:OWN, :OWN].tolist()
        at = float(state.time), float(state.temperature_c), float(state.powered)
        kept = Kept(x, P, *at, float(state.lag_k), doubted, calibration, asked, reached, bridge, session)
        with self.database.transaction():
            self._save_state(device, boot, time_ns, msgspec.msgpack.encode(kept))
            if history:
                row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns}
                for axis, name in enumerate("xyz"):
                    row |= {name: float(state.bias[axis]), f"{name}_std": float(state.std[axis])}
                celsius = float(state.temperature_c)  # SQLite stores NaN as NULL
                self.database.insert("bias_history", row | {"temperature_c": celsius})

    def save_epoch(self, epoch: int) -> None:
        """Store the highest known epoch."""
        row: Row = {"number": 1, "epoch": epoch}
        self.database.insert("epochs", row, "ON CONFLICT DO UPDATE SET epoch = excluded.epoch")

    def add_audit(
        self,
        time_ns: int,
        device: str,
        verb: str,
        request_id: str,
        who: str,
        reason: str,
        message: Sentences,
        *,
        accepted: bool,
    ) -> None:
        """Append a request to the estimator, or its refusal of a calibration, with the outcome, to the audit."""
        row: Row = {"time_ns": time_ns, "device": device, "verb": verb, "request_id": request_id, "who": who}
        self.database.insert("audit", row | {"reason": reason, "accepted": int(accepted), "message": written(message)})

    def add_placement(self, device: str, one: Placement) -> None:
        """Append a placement, which ends the one before; an empty one says that nobody wears the device any more."""
        row: Row = {"device": device, "time_ns": one.since_ns, "segment": one.segment, "side": one.side}
        self.database.insert("placements", row | {"wearer": one.wearer, "who": one.who})

    def save_alert(self, device: str, one: Alert, time_ns: int, *, cleared: bool) -> None:
        """Store an alert of a device or an estimator, or its acknowledgement or end."""
        row: Row = {"device": device, "kind": one.kind, "since_ns": one.since_ns, "raised_ns": one.raised_ns}
        row |= {"acknowledged_ns": one.acknowledged_ns, "who": one.who, "time_ns": time_ns, "cleared": int(cleared)}
        changed = ", ".join(f"{name} = excluded.{name}" for name in ("acknowledged_ns", "who", "time_ns", "cleared"))
        self.database.insert("alerts", row, f"ON CONFLICT (device, kind, raised_ns) DO UPDATE SET {changed}")

    def repeat(self, device: str, boot: int, time_ns: int, made: Iterable[str] = ()) -> None:
        """Note that another power-up has this boot number: stored calibrations and bias belong to the earlier one.

        made: ids of calibrations of the earlier power-up that are still to be written.
        """
        name = keys.boot_id(boot)
        message = written((Code.BOOT_NUMBER_REPEATED(),))
        with self.database.transaction():
            self.database.execute(
                "INSERT INTO audit (time_ns, device, verb, request_id, who, accepted, message, reason) SELECT ?, ?, ?, ?, ?, ?,"
                " ?, trim(? || ' ' || ifnull(group_concat(id, ' '), '')) FROM calibrations WHERE device = ? AND boot = ?",
                (
                    time_ns,
                    device,
                    REPEATED,
                    repeat_request(device, boot),
                    "estimator",
                    1,
                    message,
                    " ".join(made),
                    device,
                    name,
                ),
            )
            self._save_state(device, boot, time_ns, b"")

    def _save_state(self, device: str, boot: int, time_ns: int, state: bytes) -> None:
        row: Row = {"device": device, "boot": keys.boot_id(boot), "time_ns": time_ns, "state": state}
        filled = f"{_ONE_OF_BOOT} time_ns = excluded.time_ns, state = excluded.state"
        self.database.insert("bias", row, filled)

    def thin(self, device: str, now_ns: int) -> None:
        """Delete the old rows of a device: see retention."""
        with self.database.transaction():
            for statement in THIN:
                self.database.execute(statement, {"device": device, "now_ns": now_ns})

    def erase(self, device: str) -> None:
        """Delete everything of a device but its audit."""
        with self.database.transaction():
            for table in ("calibrations", "boots", "bias", "bias_history", "placements", "alerts"):
                self.database.execute(f"DELETE FROM {table} WHERE device = ?", (device,))  # noqa: S608 - our own words

    # ---- what is known ----------------------------------------------------------------------------------------------

    def devices(self) -> list[str]:
        """Every device with any stored data."""
        tables = ("boots", "calibrations", "bias", "audit")
        found = self.database.select(" UNION ".join(f"SELECT device FROM {table}" for table in tables))  # noqa: S608 - our own words
        return sorted(row["device"] for row in found)

    def calibrated_devices(self) -> set[str]:
        """Every device with a stored calibration."""
        return {row["device"] for row in self.database.select("SELECT DISTINCT device FROM calibrations")}

    def placements(self, device: str) -> list[Placement]:
        """All placements of a device, oldest first: each holds until the next."""
        names = "segment", "side", "wearer", "time_ns", "who"
        return [Placement(*(row[name] for name in names)) for row in self._added("placements", device)]

    def alerts(self, device: str) -> list[tuple[Alert, int | None]]:
        """All alerts of a device or an estimator, oldest first, each with its end, or None while it stands."""
        names = "kind", "since_ns", "raised_ns", "acknowledged_ns", "who"
        return [
            (Alert(*(row[name] for name in names)), row["time_ns"] if row["cleared"] else None)
            for row in self._added("alerts", device)
        ]

    def _added(self, table: str, device: str) -> list[Row]:
        """Rows of a device in a table that stores of schema 4, opened for reading, do not have."""
        if not self.database.rows("sqlite_schema", "name = ?", (table,), "name"):
            return []
        return self.database.rows(table, "device = ?", (device,), "number")

    def boots(self, device: str, most: int) -> list[int]:
        """Latest boots of a device, at most `most`, oldest first."""
        rows = self.database.rows("boots", "device = ?", (device,), _LATEST_FIRST, most)
        return [int(row["boot"], 16) for row in reversed(rows)]

    def answer(self, device: str, verb: str, request_id: str) -> tuple[bool, Sentences] | None:
        """Outcome of an earlier command: whether it was accepted, and its reply; None if it is new."""
        values = device, request_id, verb
        for row in self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values, limit=1):
            return bool(row["accepted"]), read_sentences(row["message"])
        return None

    def recall(self, device: str, boot: int, now_ns: int) -> PriorKnowledge | None:
        """Calibration of this boot, if any, with the bias since then and its age at now_ns; None if neither is stored."""
        calibration = self.calibrated(device, boot)
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, keys.boot_id(boot))):
            if (kept := kept_in(row)) is not None:
                age_s = (now_ns - row["time_ns"]) / 1e9
                found = PriorKnowledge(calibration, kept.state(), age_s, kept.doubted, kept.asked)
                if calibration is not None and kept.calibration != calibration.id:
                    return found.under(calibration)
                return found
        return None if calibration is None else PriorKnowledge(calibration, None)

    def session(self, device: str, boot: int) -> tuple[bytes, str]:
        """Whole session of this boot, left by an estimator stopped in order, and its bridge; empty where not stored."""
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, keys.boot_id(boot))):
            if (kept := kept_in(row)) is not None:
                return kept.session, kept.bridge
        return b"", ""

    def calibrated(self, device: str, boot: int) -> Calibration | None:
        """Latest calibration of this boot, or None."""
        made = self.of_boot(device, boot)
        return made[-1] if made else None

    def of_boot(self, device: str, boot: int) -> list[Calibration]:
        """All calibrations of this boot, in order of writing, without those of an earlier power-up."""
        before = self.made_before(device, boot)
        rows = self.database.rows("calibrations", "device = ? AND boot = ?", (device, keys.boot_id(boot)))
        return calibrations_in(row for row in rows if row["id"] not in before.ids)

    def made_before(self, device: str, boot: int) -> Before:
        """Calibrations under this boot number that belong to an earlier power-up."""
        values = device, repeat_request(device, boot), REPEATED
        repeats = self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values)
        ids = frozenset(made for row in repeats for made in row["reason"].split())
        return Before(ids, max((row["time_ns"] for row in repeats), default=None))

    def reached(self, since_ns: int) -> dict[str, tuple[int, int, int, str]]:
        """Last sample known to the latest stored bias, by device: boot, sequence number, host time in ns, and bridge.

        The bridge is empty where unknown. Only biases stored since since_ns count. Devices with a running calibration
        are left out: the bridges' caches may hold its turns.
        """
        found: dict[str, tuple[int, int, int, str]] = {}
        for row in self.database.rows("bias", "time_ns >= ?", (since_ns,), "time_ns"):
            found.pop(row["device"], None)
            kept = kept_in(row)
            if kept is not None and kept.reached is not None and kept.asked is None:
                found[row["device"]] = int(row["boot"], 16), *kept.reached, kept.bridge
        return found

    def epoch(self) -> int:
        """Highest stored epoch; 0 where none is stored."""
        return max((int(row["epoch"]) for row in self.database.rows("epochs")), default=0)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """Latest calibration of an earlier boot with the same restore key, or None.

        The key is device, model, firmware, range, and mostly rate.
        """
        this = keys.boot_id(info.boot)
        return self._latest(info.device, lambda row: row["boot"] != this and not differing(row, info))

    def earlier(self, info: DeviceInfo) -> list[Calibration]:
        """Last calibration of each recent earlier boot with the same restore key, oldest first."""
        this, found = keys.boot_id(info.boot), dict[str, Row]()
        for row in self.database.rows("calibrations", "device = ?", (info.device,), _LATEST_FIRST, _FEW):
            if row["boot"] not in {this, *found} and not differing(row, info):
                found[row["boot"]] = row
        return calibrations_in(reversed(found.values()))

    def latest(self, device: str) -> Calibration | None:
        """Latest calibration of a device, whatever its restore key."""
        return self._latest(device, lambda _: True)

    def points(self, info: DeviceInfo) -> list[Points]:
        """Bias history of the latest earlier boots with the same restore key, where the temperature is known."""
        this = keys.boot_id(info.boot)
        rows = self.database.rows("boots", "device = ?", (info.device,), _LATEST_FIRST)
        boots = [row for row in rows if row["boot"] != this and not differing(row, info)][:BOOTS]
        return [found for boot in boots if (found := self._points(boot)) is not None]

    def _points(self, boot: Row) -> Points | None:
        where = "device = ? AND boot = ? AND time_ns >= ? AND temperature_c IS NOT NULL"
        values = boot["device"], boot["boot"], boot["time_ns"]
        rows = self.database.rows("bias_history", where, values, "time_ns", POINTS)
        names = ("time_ns", "x", "y", "z", "x_std", "y_std", "z_std", "temperature_c")
        table = np.array([[row[name] for name in names] for row in rows], float)
        return Points(1e-9 * table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7]) if len(table) else None

    def calibrations(self, device: str) -> list[Calibration]:
        """All calibrations of a device, oldest first."""
        return calibrations_in(self.database.rows("calibrations", "device = ?", (device,), "time_ns, number"))

    def _latest(self, device: str, wanted: Callable[[Row], bool]) -> Calibration | None:
        for few in (_FEW, -1):
            rows = self.database.rows("calibrations", "device = ?", (device,), _LATEST_FIRST, few)
            if found := calibrations_in(row for row in rows if wanted(row)):
                return found[0]
        return None
