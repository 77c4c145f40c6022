"""What the estimator keeps: one SQLite file with calibrations, boots, bias history and an audit of commands.

Append-only but for the latest bias of each boot. Calibrations are kept as their wire bytes with a digest: what was
damaged on disk is refused and reported, never used. The only file that imports sqlite3.
"""

import hashlib
import json
import logging
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np

from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, Calibration, DeviceInfo, Verdict
from bridge.wire.refusal import Refusal
from estimator.session import Remembered
from estimator.track.bias_filter import BiasState
from estimator.track.learning import Points

log = logging.getLogger(__name__)

SCHEMA_VERSION = 1
APPLICATION_ID = 0x74725254  # "trRT", in the file's header
#: what a temperature law is learnt from: so many boots, and so many points, the first, of each
BOOTS, POINTS = 8, 300
_TABLES = {"calibrations", "boots", "bias", "bias_history", "audit"}
_SCHEMA = """
CREATE TABLE calibrations (
    id TEXT PRIMARY KEY, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, method TEXT NOT NULL,
    verdict TEXT NOT NULL, reason TEXT NOT NULL, who TEXT NOT NULL,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL,
    payload BLOB NOT NULL, digest TEXT NOT NULL
) STRICT;
CREATE INDEX calibrations_by_device ON calibrations (device, time_ns);
CREATE TABLE boots (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, cause TEXT NOT NULL,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL,
    PRIMARY KEY (device, boot)
) STRICT;
CREATE TABLE bias (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, state TEXT NOT NULL, digest TEXT NOT NULL,
    PRIMARY KEY (device, boot)
) STRICT;
CREATE TABLE bias_history (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL,
    x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL, x_std REAL NOT NULL, y_std REAL NOT NULL, z_std REAL NOT NULL,
    temperature_c REAL
) STRICT;
CREATE INDEX bias_history_by_device ON bias_history (device, time_ns);
CREATE TABLE audit (
    time_ns INTEGER NOT NULL, device TEXT NOT NULL, verb TEXT NOT NULL, request_id TEXT NOT NULL, who TEXT NOT NULL,
    reason TEXT NOT NULL, accepted INTEGER NOT NULL, message TEXT NOT NULL
) STRICT;
CREATE INDEX audit_by_request ON audit (request_id);
"""


class StoreError(Exception):
    """The store could not be opened or written: which file, why, what to do."""


class Store:
    """One open store; used from one thread."""

    def __init__(self, path: Path | str) -> None:
        self.path = str(path)
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, timeout=5.0, check_same_thread=False)
        except (sqlite3.Error, OSError) as error:
            raise self._unusable(error) from error
        try:
            self._open()
        except sqlite3.Error as error:
            self._db.close()
            raise self._unusable(error) from error
        except StoreError:
            self._db.close()
            raise

    def _open(self) -> None:
        # Looked at before anything is written: it may be somebody else's.
        version, application = (self._pragma(name) for name in ("user_version", "application_id"))
        tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if application not in (0, APPLICATION_ID) or (version == 0 and tables):
            raise StoreError(f"store {self.path} is another program's SQLite file: give the store a path of its own")
        if version not in (0, SCHEMA_VERSION):
            raise StoreError(
                f"store {self.path} has schema {version}, this truerate knows {SCHEMA_VERSION}: update truerate"
            )
        if version and not tables >= _TABLES:
            missing = ", ".join(sorted(_TABLES - tables))
            raise StoreError(f"store {self.path} has no table {missing}: restore it from a backup, or move it away")
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")
        if version == 0:
            self._db.executescript(f"BEGIN;{_SCHEMA}PRAGMA user_version = {SCHEMA_VERSION};COMMIT;")
        if application == 0:
            self._db.execute(f"PRAGMA application_id = {APPLICATION_ID}")

    def _pragma(self, name: str) -> int:
        return int(self._db.execute(f"PRAGMA {name}").fetchone()[0])

    def _unusable(self, error: Exception) -> StoreError:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_NOTADB:
            return StoreError(f"store {self.path} is not an SQLite file: give the store a path of its own")
        return StoreError(f"store {self.path}: {error}; check that the folder exists, is writable and has room")

    def close(self) -> None:
        """Close; what was written is on disk already."""
        self._db.close()

    def add_calibration(self, calibration: Calibration) -> None:
        """Append a calibration, before anyone is told of it; only an accepted one is a calibration."""
        if calibration.verdict is not Verdict.ACCEPTED:
            raise ValueError(f"a calibration with verdict {calibration.verdict.name} is not stored")
        c, payload = calibration, codec.encode_calibration(calibration)
        row = (
            c.id,
            c.device,
            keys.boot_id(c.boot),
            c.time_ns,
            c.method,
            c.verdict.name,
            c.reason,
            c.who,
            *_restore_key(c),
        )
        self._write(
            "INSERT OR IGNORE INTO calibrations VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?)", (*row, payload, _digest(payload))
        )

    def add_boot(self, info: DeviceInfo, time_ns: int) -> None:
        """Note a boot; the same boot again changes nothing."""
        row = (info.device, keys.boot_id(info.boot), time_ns, BootCause(info.boot_cause).name, *_restore_key(info))
        self._write("INSERT OR IGNORE INTO boots VALUES (?,?,?,?,?,?,?,?)", row)

    def save_bias(self, device: str, boot: int, time_ns: int, state: BiasState, *, history: bool) -> None:
        """Keep the latest bias of a boot for a restart; with history also as a point of the device's record."""
        powered = _or_none(state.powered)
        text = json.dumps([state.x.tolist(), state.P.tolist(), state.time, _or_none(state.temperature_c), powered])
        name = keys.boot_id(boot)
        row = (device, name, time_ns, text, _digest(text.encode()))
        self._write("INSERT OR REPLACE INTO bias VALUES (?,?,?,?,?)", row)
        if history:
            point = (
                device,
                name,
                time_ns,
                *map(float, state.bias),
                *map(float, state.std),
                _or_none(state.temperature_c),
            )
            self._write("INSERT INTO bias_history VALUES (?,?,?,?,?,?,?,?,?,?)", point)

    def add_audit(
        self,
        time_ns: int,
        device: str,
        verb: str,
        request_id: str,
        who: str,
        reason: str,
        message: str,
        *,
        accepted: bool,
    ) -> None:
        """Append what was asked of the estimator, or what it refused, and what came of it."""
        row = (time_ns, device, verb, request_id, who, reason, int(accepted), message)
        self._write("INSERT INTO audit VALUES (?,?,?,?,?,?,?,?)", row)

    def answer(self, device: str, verb: str, request_id: str) -> tuple[bool, str] | None:
        """Whether a command that came before was accepted, and the words it was answered with."""
        query = "SELECT accepted, message FROM audit WHERE request_id = ? AND device = ? AND verb = ? ORDER BY rowid LIMIT 1"
        rows = self._read(query, (request_id, device, verb))
        return (bool(rows[0][0]), str(rows[0][1])) if rows else None

    def recall(self, device: str, boot: int, now_ns: int) -> Remembered | None:
        """The calibration of this very boot, with the bias since, and its age at now_ns."""
        calibration = self._calibration("device = ? AND boot = ?", (device, keys.boot_id(boot)))
        if calibration is None:
            return None
        bias, kept_ns = self._bias(device, boot)
        return Remembered(calibration, bias, (now_ns - kept_ns) / 1e9 if bias is not None else 0.0)

    def prior(self, info: DeviceInfo) -> Calibration | None:
        """The last calibration of an earlier boot under the same restore key: device, model, firmware, range, and mostly rate."""
        return self._calibration(_EARLIER, _earlier(info))

    def points(self, info: DeviceInfo) -> list[Points]:
        """The bias history of the latest earlier boots under the same restore key, where the temperature is known."""
        query = f"SELECT boot, time_ns FROM boots WHERE {_EARLIER} ORDER BY time_ns DESC LIMIT ?"  # noqa: S608 - our own words
        boots = self._read(query, (*_earlier(info), BOOTS))
        return [found for boot in boots if (found := self._points(info.device, *boot)) is not None]

    def _points(self, device: str, boot: str, since_ns: int) -> Points | None:
        query = (
            "SELECT time_ns, x, y, z, x_std, y_std, z_std, temperature_c FROM bias_history"
            " WHERE device = ? AND boot = ? AND time_ns >= ? AND temperature_c IS NOT NULL ORDER BY time_ns LIMIT ?"
        )
        rows = np.array(self._read(query, (device, boot, since_ns, POINTS)), float)
        return Points(1e-9 * rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7]) if len(rows) else None

    def calibrations(self, device: str) -> list[Calibration]:
        """All whole calibrations of a device, oldest first."""
        query = "SELECT id, payload, digest FROM calibrations WHERE device = ? ORDER BY time_ns, rowid"
        rows = self._read(query, (device,))
        return [found for row in rows if (found := self._whole(device, *row)) is not None]

    def _calibration(self, where: str, values: tuple[object, ...]) -> Calibration | None:
        query = f"SELECT id, payload, digest FROM calibrations WHERE {where} ORDER BY time_ns DESC, rowid DESC"  # noqa: S608 - our own words
        rows = self._read(query, values)
        return next((found for row in rows if (found := self._whole(str(values[0]), *row)) is not None), None)

    def _whole(self, device: str, name: str, payload: bytes, digest: str) -> Calibration | None:
        try:
            if digest != _digest(payload):
                raise ValueError("its digest does not match")
            return codec.decode_calibration(keys.build("store", "calibration", device=device), payload)
        except (ValueError, Refusal) as error:
            log.error("store %s: calibration %s is damaged (%s) and is not used", self.path, name, error)
            return None

    def _bias(self, device: str, boot: int) -> tuple[BiasState | None, int]:
        query = "SELECT state, digest, time_ns FROM bias WHERE device = ? AND boot = ?"
        rows = self._read(query, (device, keys.boot_id(boot)))
        if not rows:
            return None, 0
        row = rows[0]
        if row[1] != _digest(row[0].encode()):
            log.error("store %s: the bias of %s is damaged and is not used", self.path, device)
            return None, 0
        return _state(json.loads(row[0])), int(row[2])

    def _read(self, query: str, values: tuple[object, ...]) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise StoreError(f"store {self.path}: {error}; restore it from a backup") from error

    def _write(self, statement: str, values: tuple[object, ...]) -> None:
        try:
            with self._db:
                self._db.execute(statement, values)
        except sqlite3.Error as error:
            raise StoreError(f"store {self.path}: {error}; is the disk full or read-only?") from error


#: a device with a clock of its own may be told another rate, as for a calibration; without one its scale hangs on its rate
_EARLIER = "device = ? AND model = ? AND firmware = ? AND gyro_range = ? AND (rate_hz = ? OR ?) AND boot != ?"


def _earlier(info: DeviceInfo) -> tuple[object, ...]:
    return info.device, *_restore_key(info), info.has_clock, keys.boot_id(info.boot)


def _restore_key(of: Calibration | DeviceInfo) -> tuple[str, str, float, float]:
    return of.model, of.firmware, of.gyro_range, of.rate_hz


def _state(kept: list[Any]) -> BiasState | None:
    if len(kept) != 5:  # of an earlier truerate: the calibration's own bias is used
        return None
    x, P, time, temperature, powered = kept
    celsius, since = np.nan if temperature is None else temperature, -np.inf if powered is None else powered
    return BiasState(np.array(x), np.array(P), time, celsius, since)


def _digest(payload: bytes) -> str:
    return hashlib.sha256(payload).hexdigest()


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
