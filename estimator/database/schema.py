"""The schema and how it came to be: numbered migrations, each from the one before, within one transaction.

A migration is never changed once it has been released. It speaks to any connection that has `execute`.
"""

import hashlib
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from estimator.database.seal import COLUMN, seal

APPLICATION_ID = 0x74725254  # "trRT", in the file's header


class Connection(Protocol):
    """As much of a connection as a migration needs."""

    def execute(self, sql: str, parameters: tuple[Any, ...] = ..., /) -> Iterable[tuple[Any, ...]]:
        """Do one statement; its rows."""


_FIRST = """
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

# Whatever rows are looked up by is in an index beside the table: a flipped bit in either makes the two differ.
_SEALED = """
CREATE TABLE calibrations (
    id TEXT PRIMARY KEY, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, method TEXT NOT NULL,
    verdict TEXT NOT NULL, reason TEXT NOT NULL, who TEXT NOT NULL, version TEXT,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL,
    payload BLOB NOT NULL, digest BLOB NOT NULL
) STRICT;
CREATE INDEX calibrations_by_device ON calibrations (device, time_ns);
CREATE TABLE boots (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, cause TEXT NOT NULL,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL, digest BLOB NOT NULL,
    PRIMARY KEY (device, boot)
) STRICT;
CREATE TABLE bias (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, state TEXT NOT NULL, digest BLOB NOT NULL,
    PRIMARY KEY (device, boot)
) STRICT;
CREATE TABLE bias_history (
    device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL,
    x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL, x_std REAL NOT NULL, y_std REAL NOT NULL, z_std REAL NOT NULL,
    temperature_c REAL, digest BLOB NOT NULL
) STRICT;
CREATE INDEX bias_history_by_boot ON bias_history (device, boot, time_ns);
CREATE TABLE audit (
    time_ns INTEGER NOT NULL, device TEXT NOT NULL, verb TEXT NOT NULL, request_id TEXT NOT NULL, who TEXT NOT NULL,
    reason TEXT NOT NULL, accepted INTEGER NOT NULL, message TEXT NOT NULL, digest BLOB NOT NULL
) STRICT;
CREATE INDEX audit_by_request ON audit (request_id);
CREATE INDEX audit_by_device ON audit (device, time_ns);
"""

TABLES = ("calibrations", "boots", "bias", "bias_history", "audit")


def columns(db: Connection, table: str) -> dict[str, str]:
    """The type of each column, by name, in order."""
    return {name: kind for _, name, kind, *_ in db.execute(f"PRAGMA table_info({table})")}


def _first(db: Connection) -> None:
    _run(db, _FIRST)


def _seal_everything(db: Connection) -> None:
    """Schema 2: every row has a seal. A row whose old digest was wrong gets none, and stays refused."""
    for index in ("calibrations_by_device", "bias_history_by_device", "audit_by_request"):
        db.execute(f"DROP INDEX {index}")
    for table in TABLES:
        db.execute(f"ALTER TABLE {table} RENAME TO old_{table}")
    _run(db, _SEALED)
    for table in TABLES:
        names = list(columns(db, f"old_{table}"))
        for values in list(db.execute(f"SELECT {', '.join(names)} FROM old_{table} ORDER BY rowid")):  # noqa: S608 - our own words
            row = dict(zip(names, values, strict=True))
            before = row.pop(COLUMN, None)
            content = row.get("payload", row.get("state"))
            whole = before is None or before == _old_digest(content)
            row[COLUMN] = seal(table, row) if whole else b""
            places = ", ".join("?" * len(row))
            db.execute(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({places})", tuple(row.values()))  # noqa: S608 - our own words
        db.execute(f"DROP TABLE old_{table}")


def _old_digest(content: object) -> str:
    return hashlib.sha256(content if isinstance(content, bytes) else str(content).encode()).hexdigest()


def _run(db: Connection, script: str) -> None:
    for statement in filter(str.strip, script.split(";")):
        db.execute(statement.strip())


MIGRATIONS: tuple[Callable[[Connection], None], ...] = (_first, _seal_everything)
SCHEMA_VERSION = len(MIGRATIONS)
#: from this schema on every row has a seal
SEALED_FROM = 2


def build(db: Connection, version: int) -> None:
    """Make an empty database one of that schema."""
    for migrate in MIGRATIONS[:version]:
        migrate(db)
    mark(db, version)


def mark(db: Connection, version: int) -> None:
    """Write into the file's header what it is."""
    db.execute(f"PRAGMA user_version = {version}")
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")


def described(db: Connection) -> frozenset[tuple[str, str, str | None]]:
    """Everything a database consists of: kind, name and the words that made it, blanks aside."""
    found = db.execute("SELECT type, name, sql FROM sqlite_master")
    # Of a damaged file any of these may be of any type.
    return frozenset((str(kind), str(name), sql and " ".join(str(sql).split())) for kind, name, sql in found)
