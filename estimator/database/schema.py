"""Schema of a store: creates the tables, and checks that a store is intact.

Each table has an index over all its columns. The index serves the queries and holds each value a second time. SQLite's
integrity check compares the two, so that it finds a flipped bit in either.
The schema version is also in the SQL text. A flipped bit in the header's version is harmless if the tables are those of
this version.
"""

import sqlite3
from contextlib import closing
from functools import cache

from estimator.database.errors import Damaged, StoreError

APPLICATION_ID = 0x74725254  # "trRT", in the file's header
#: versions 1 to 4 were never released
SCHEMA_VERSION = 5

#: a store has exactly these words, and a changed comment is a change, too
_SCHEMA = """
CREATE TABLE calibrations ( -- schema 4
    number INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL,
    method TEXT NOT NULL, verdict TEXT NOT NULL, reason TEXT NOT NULL, who TEXT NOT NULL, version TEXT NOT NULL,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL, payload BLOB NOT NULL
) STRICT;
CREATE INDEX calibrations_all ON calibrations (
    device, number, id, boot, time_ns, method, verdict, reason, who, version, model, firmware, gyro_range, rate_hz, payload
);
CREATE TABLE boots (
    number INTEGER PRIMARY KEY, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, cause TEXT NOT NULL,
    model TEXT NOT NULL, firmware TEXT NOT NULL, gyro_range REAL NOT NULL, rate_hz REAL NOT NULL, UNIQUE (device, boot)
) STRICT;
CREATE INDEX boots_all ON boots (device, number, boot, time_ns, cause, model, firmware, gyro_range, rate_hz);
CREATE TABLE bias (
    number INTEGER PRIMARY KEY, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL, state BLOB NOT NULL,
    UNIQUE (device, boot)
) STRICT;
CREATE INDEX bias_all ON bias (device, boot, time_ns, state);
CREATE TABLE bias_history (
    number INTEGER PRIMARY KEY, device TEXT NOT NULL, boot TEXT NOT NULL, time_ns INTEGER NOT NULL,
    x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL, x_std REAL NOT NULL, y_std REAL NOT NULL, z_std REAL NOT NULL,
    temperature_c REAL
) STRICT;
CREATE INDEX bias_history_all ON bias_history (
    device, boot, time_ns, x, y, z, x_std, y_std, z_std, temperature_c
);
CREATE TABLE audit (
    number INTEGER PRIMARY KEY, time_ns INTEGER NOT NULL, device TEXT NOT NULL, verb TEXT NOT NULL, request_id TEXT NOT NULL,
    who TEXT NOT NULL, reason TEXT NOT NULL, accepted INTEGER NOT NULL, message TEXT NOT NULL
) STRICT;
CREATE INDEX audit_all ON audit (device, request_id, verb, time_ns, who, reason, accepted, message);
CREATE TABLE epochs (number INTEGER PRIMARY KEY, epoch INTEGER NOT NULL) STRICT;
CREATE INDEX epochs_all ON epochs (epoch);
CREATE TABLE placements ( -- schema 5
    number INTEGER PRIMARY KEY, device TEXT NOT NULL, time_ns INTEGER NOT NULL, segment TEXT NOT NULL, side TEXT NOT NULL,
    wearer TEXT NOT NULL, who TEXT NOT NULL
) STRICT;
CREATE INDEX placements_all ON placements (device, number, time_ns, segment, side, wearer, who);
CREATE TABLE alerts (
    number INTEGER PRIMARY KEY, device TEXT NOT NULL, kind TEXT NOT NULL, since_ns INTEGER NOT NULL, raised_ns INTEGER NOT NULL,
    acknowledged_ns INTEGER NOT NULL, who TEXT NOT NULL, time_ns INTEGER NOT NULL, cleared INTEGER NOT NULL,
    UNIQUE (device, kind, raised_ns)
) STRICT;
CREATE INDEX alerts_all ON alerts (device, cleared, number, kind, since_ns, raised_ns, acknowledged_ns, who, time_ns);
"""
#: tables with entries of devices
ENTRIES = ("calibrations", "boots", "bias", "bias_history", "audit", "placements", "alerts")


def create(db: sqlite3.Connection) -> None:
    """Create the tables in an empty database, in one transaction."""
    marks = f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {SCHEMA_VERSION};"
    db.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} {marks} COMMIT;")


def check(db: sqlite3.Connection, path: object) -> None:
    """Check that an open database is a store of this schema, and that its content is intact.

    path: the file, for messages. Raises StoreError for another schema, and Damaged if the content differs from what was
    written.
    """
    version, application = (_pragma(db, name) for name in ("user_version", "application_id"))
    found = _described(db)
    if not found:
        raise Damaged(path, "the file has no tables")
    if found != _expected():
        if application != APPLICATION_ID:
            raise StoreError(f"store {path} is another program's SQLite file: give the store a path of its own")
        if version != SCHEMA_VERSION:
            raise StoreError(
                f"store {path} has schema {version}, but this truerate reads schema {SCHEMA_VERSION}: use the version of"
                f" truerate that wrote the store, or give another path"
            )
        raise Damaged(path, f"the tables are not those of schema {version}")
    for (words,) in db.execute("PRAGMA integrity_check(1)"):
        if words != "ok":
            raise Damaged(path, str(words).removeprefix("*** in database main ***").strip())


def rows_of(db: sqlite3.Connection) -> dict[str, int]:
    """Return the number of rows by table, for the tables with entries about devices."""
    return {table: int(db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]) for table in ENTRIES}  # noqa: S608 - our own words


def _pragma(db: sqlite3.Connection, name: str) -> int:
    return int(db.execute(f"PRAGMA {name}").fetchone()[0])


def _described(db: sqlite3.Connection) -> set[tuple[str, str, str]]:
    """Return everything that a database consists of: kind, name and SQL of each object."""
    return {(kind, name, str(sql)) for kind, name, sql in db.execute("SELECT type, name, sql FROM sqlite_schema")}


@cache
def _expected() -> set[tuple[str, str, str]]:
    with closing(sqlite3.connect(":memory:")) as db:
        create(db)
        return _described(db)
