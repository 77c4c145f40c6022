"""Read-only queries on a ward's store: devices, calibrations, boots, biases, placements and alerts. For any thread."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from bridge.reasons.codes import Sentences
from bridge.wire import keys
from bridge.wire.messages import Alert, Calibration, DeviceInfo, Placement
from estimator.database import Database, Row
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.restore_key import differing
from estimator.service.retention import BOOTS, POINTS
from estimator.service.store_rows import Before, Kept, calibrations_in, kept_in, read_sentences, repeat_request
from estimator.tracking.temperature_learning import Points

#: audit verb for a boot number that another power-up had before
REPEATED = "boot number repeated"
#: order of writing, latest first, since a clock may have been wrong
_LATEST_FIRST = "number DESC"
#: number of calibrations read first: most often the latest one fits
_FEW = 8


class StoreReader:
    """Reader of a ward's store.

    Methods raise StoreError if the store cannot be read. If the database was opened as patient, queries return no rows
    instead.
    """

    def __init__(self, database: Database) -> None:
        self.database = database

    @classmethod
    def reading(cls, path: Path | str) -> "StoreReader":
        """Open a store for reading only, also while an estimator uses it.

        Raises StoreError if it is damaged or unreadable.
        """
        return StoreReader(Database.reading(path))

    @property
    def path(self) -> str:
        """Path of the store's file."""
        return self.database.path

    def close(self) -> None:
        """Close the store. All writes are on disk already."""
        self.database.close()

    def devices(self) -> list[str]:
        """Return the sorted ids of all devices with a stored boot, calibration, bias or command."""
        tables = ("boots", "calibrations", "bias", "audit")
        found = self.database.select(" UNION ".join(f"SELECT device FROM {table}" for table in tables))  # noqa: S608 - our own words
        return sorted(row["device"] for row in found)

    def calibrated_devices(self) -> set[str]:
        """Return the ids of all devices with a stored calibration."""
        return {row["device"] for row in self.database.select("SELECT DISTINCT device FROM calibrations")}

    def placements(self, device: str) -> list[Placement]:
        """Return all placements of a device (where and by whom it was worn), oldest first.

        Each placement holds until the next.
        """
        names = "segment", "side", "wearer", "time_ns", "who"
        return [
            Placement(*(row[name] for name in names))
            for row in self.database.rows("placements", "device = ?", (device,), "number")
        ]

    def alerts(self, device: str) -> list[tuple[Alert, int | None]]:
        """Return all alerts of a device or an estimator, oldest first, each with the time of its end.

        This is host time, ns since the Unix epoch; None if the alert has not ended.
        """
        names = "kind", "since_ns", "raised_ns", "acknowledged_ns", "who"
        return [
            (Alert(*(row[name] for name in names)), row["time_ns"] if row["cleared"] else None)
            for row in self.database.rows("alerts", "device = ?", (device,), "number")
        ]

    def boots(self, device: str, most: int) -> list[int]:
        """Return the latest boot ids of a device, at most `most`, oldest first."""
        rows = self.database.rows("boots", "device = ?", (device,), _LATEST_FIRST, most)
        return [int(row["boot"], 16) for row in reversed(rows)]

    def answer(self, device: str, verb: str, request_id: str) -> tuple[bool, Sentences] | None:
        """Return the outcome of an earlier command: whether it was accepted, and its reply.

        None if the command is new.
        """
        values = device, request_id, verb
        for row in self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values, limit=1):
            return bool(row["accepted"]), read_sentences(row["message"])
        return None

    def recall(self, device: str, boot: int, now_ns: int) -> PriorKnowledge | None:
        """Return the latest calibration of a boot and the bias last stored in it; None if neither is stored.

        now_ns: host time, ns since the Unix epoch, for the age of the bias.
        """
        calibration, (kept, time_ns) = self.calibrated(device, boot), self._kept(device, boot)
        if kept is None:
            return None if calibration is None else PriorKnowledge(calibration, None)
        found = PriorKnowledge(calibration, kept.state(), (now_ns - time_ns) / 1e9, kept.doubted, kept.asked)
        return found if calibration is None or kept.calibration == calibration.id else found.under(calibration)

    def session(self, device: str, boot: int) -> tuple[bytes, str]:
        """Return the session saved as bytes at an orderly stop during a boot, and the id of the bridge it used.

        Bytes and id are empty if no session was saved.
        """
        kept, _ = self._kept(device, boot)
        return (b"", "") if kept is None else (kept.session, kept.bridge)

    def _kept(self, device: str, boot: int) -> tuple[Kept | None, int]:
        """Bias stored last in this boot, None if there is none, and its host time, ns."""
        for row in self.database.rows("bias", "device = ? AND boot = ?", (device, keys.boot_id(boot))):
            return kept_in(row), row["time_ns"]
        return None, 0

    def calibrated(self, device: str, boot: int) -> Calibration | None:
        """Return the latest calibration of a boot, or None."""
        made = self.of_boot(device, boot)
        return made[-1] if made else None

    def of_boot(self, device: str, boot: int) -> list[Calibration]:
        """Return all calibrations of a boot, in order of writing, without those of an earlier power-up."""
        before = self.made_before(device, boot)
        rows = self.database.rows("calibrations", "device = ? AND boot = ?", (device, keys.boot_id(boot)))
        return calibrations_in(row for row in rows if row["id"] not in before.ids)

    def made_before(self, device: str, boot: int) -> Before:
        """Find the calibrations under this boot number that belong to an earlier power-up."""
        values = device, repeat_request(device, boot), REPEATED
        repeats = self.database.rows("audit", "device = ? AND request_id = ? AND verb = ?", values)
        ids = frozenset(made for row in repeats for made in row["reason"].split())
        return Before(ids, max((row["time_ns"] for row in repeats), default=None))

    def reached(self, since_ns: int) -> dict[str, tuple[int, int, int, str]]:
        """Return, by device id, the last sample that was used for the stored bias.

        since_ns: biases stored before this host time, ns since the Unix epoch, are left out.
        Values: boot id, sequence number, host time in ns since the Unix epoch, and bridge, empty where unknown.
        Devices with a requested recalibration, or with turns taken, are left out: bridges may replay the samples of
        these turns.
        """
        found: dict[str, tuple[int, int, int, str]] = {}
        for row in self.database.rows("bias", "time_ns >= ?", (since_ns,), "time_ns"):
            found.pop(row["device"], None)
            kept = kept_in(row)
            if kept is not None and kept.reached is not None and kept.asked is None:
                found[row["device"]] = int(row["boot"], 16), *kept.reached, kept.bridge
        return found

    def last_run(self, within_ns: int) -> dict[str, tuple[int, int, str]]:
        """Return the devices that were served at the end of the last run, or whose `lost` alert had not ended.

        within_ns: a device was served if its bias was stored at most this long, ns, before the newest bias of the store.
        By device id: boot id, host time at which its bias was stored in ns since the Unix epoch, and bridge, empty if
        unknown.
        """
        newest = self.database.select("SELECT max(time_ns) AS time_ns FROM bias")
        if not newest or newest[0]["time_ns"] is None:
            return {}
        lost = "SELECT device FROM alerts WHERE kind = 'lost' AND NOT cleared"
        where = f"time_ns >= ? OR device IN ({lost})"
        rows = self.database.rows("bias", where, (newest[0]["time_ns"] - within_ns,), "time_ns")
        found = [(row, kept_in(row)) for row in rows]
        return {
            row["device"]: (int(row["boot"], 16), row["time_ns"], kept.bridge if kept else "") for row, kept in found
        }

    def epoch(self) -> int:
        """Return the highest stored epoch; 0 if none is stored.

        The epoch is the ownership number, which rises with each takeover.
        """
        return max((int(row["epoch"]) for row in self.database.rows("epochs")), default=0)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """Return the latest calibration of an earlier boot with the same restore key as `info`, or None.

        The key is device, model, firmware, range and, for a device without a clock, rate.
        """
        this = keys.boot_id(info.boot)
        return self._latest(info.device, lambda row: row["boot"] != this and not differing(row, info))

    def earlier(self, info: DeviceInfo) -> list[Calibration]:
        """Return the last calibration of each recent earlier boot with the same restore key as `info`, oldest first.

        The key is device, model, firmware, range and, for a device without a clock, rate. Only the newest 8 stored
        calibrations are searched.
        """
        this, found = keys.boot_id(info.boot), dict[str, Row]()
        for row in self.database.rows("calibrations", "device = ?", (info.device,), _LATEST_FIRST, _FEW):
            if row["boot"] not in {this, *found} and not differing(row, info):
                found[row["boot"]] = row
        return calibrations_in(reversed(found.values()))

    def latest(self, device: str) -> Calibration | None:
        """Return the latest calibration of a device, of any boot and settings, or None."""
        return self._latest(device, lambda _: True)

    def points(self, info: DeviceInfo) -> list[Points]:
        """Return the bias history of the latest earlier boots with the same restore key as `info`, one item per boot.

        Each item has biases with standard deviation, rad/s, and temperatures, °C. At most BOOTS boots, and the first
        POINTS points of each where the temperature is known.
        """
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
        """Return all stored calibrations of a device, oldest first."""
        return calibrations_in(self.database.rows("calibrations", "device = ?", (device,), "time_ns, number"))

    def _latest(self, device: str, wanted: Callable[[Row], bool]) -> Calibration | None:
        for few in (_FEW, -1):
            rows = self.database.rows("calibrations", "device = ?", (device,), _LATEST_FIRST, few)
            if found := calibrations_in(row for row in rows if wanted(row)):
                return found[0]
        return None
