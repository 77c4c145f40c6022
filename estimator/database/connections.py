"""SQLite connections to a store: opens one to write and any number to read, and checks a store."""

import logging
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from estimator.database.errors import ADVICE, FAULTS, Damaged, StoreError, translated
from estimator.database.owner import check_regular
from estimator.database.schema import APPLICATION_ID, check, rows_of

log = logging.getLogger(__name__)

#: opens a connection, with the parameters of sqlite3.connect
Connect = Callable[..., sqlite3.Connection]

#: a check that takes longer than this is logged, s
SLOW_S = 2.0
_MAGIC, _APPLICATION = b"SQLite format 3\0", slice(68, 72)


def to_write(path: Path | str, connect: Connect = sqlite3.connect) -> sqlite3.Connection:
    """Open a connection to write a store; a commit is on disk when it returns, and no transaction begins implicitly.

    connect: sqlite3.connect, or a test's substitute. Raises sqlite3.Error if the file cannot be opened or written.
    """
    db = connect(str(path), timeout=5.0, isolation_level=None, check_same_thread=False)
    try:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        db.execute("BEGIN IMMEDIATE")  # fails at once if the file is read-only
        db.execute("ROLLBACK")
    except BaseException:
        db.close()
        raise
    return db


def to_read(path: Path) -> sqlite3.Connection:
    """Open a read-only connection to a store. Raises sqlite3.Error if that fails.

    No file is left beside a store that no other process has open.
    """
    alone = "" if log_of(path).exists() else "&immutable=1"
    uri = f"{path.absolute().as_uri()}?mode=ro{alone}"
    return sqlite3.connect(uri, uri=True, timeout=5.0, isolation_level=None, check_same_thread=False)


def checked(path: Path, *, ours: bool = False) -> sqlite3.Connection:
    """Check that a store is intact, and return a read-only connection to it.

    ours: True if the file is known to be a store, even if its header is damaged.
    Raises Damaged if the content differs from what was written, and StoreError if the file is missing or not a store.
    Raises Unavailable if the file cannot be read.
    """
    db = None
    try:
        if not path.exists():
            raise StoreError(f"store {path}: there is no such file; {ADVICE}")
        check_regular(path, path.stat().st_mode)
        megabytes = path.stat().st_size / 1e6
        slow = threading.Timer(SLOW_S, log.info, ("store %s: checking %.0f MB", path, megabytes))
        slow.daemon = True
        slow.start()
        try:
            if not megabytes:
                raise Damaged(path, "the file is empty")
            db = to_read(path)
            check(db, path)
        finally:
            slow.cancel()
    except (*FAULTS, StoreError) as error:
        if db is not None:
            db.close()
        found = error if isinstance(error, StoreError) else translated(str(path), error)
        if isinstance(error, sqlite3.Error) and type(found) is StoreError:  # our own SQL is right
            found = Damaged(path, error)
        if isinstance(found, Damaged) and not ours and not _is_ours(path):
            found = StoreError(f"{path} is not a truerate store: {ADVICE}")
        raise found from error
    return db


def log_of(path: Path) -> Path:
    """Return the path of a store's SQLite write-ahead log."""
    return path.with_name(path.name + "-wal")


def _is_ours(path: Path) -> bool:
    """Return whether a damaged file was a store, by its header."""
    with path.open("rb") as file:
        head = file.read(_APPLICATION.stop)
    return _MAGIC.startswith(head[: len(_MAGIC)]) or head[_APPLICATION] == APPLICATION_ID.to_bytes(4, "big")


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of checking a store's file.

    fault: damage that was found; empty if the store is intact. rows: number of rows by table, of an intact store.
    """

    path: str
    fault: str = ""
    rows: dict[str, int] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """True if the store is intact."""
        return not self.fault


def inspect(path: Path) -> Inspection:
    """Check a store, in use or not; returns the damage, or the number of rows of each table.

    Raises StoreError if the file does not exist, is not a store or cannot be read. Damage raises no error.
    """
    try:
        db = checked(path)
    except Damaged as damage:
        return Inspection(str(path), str(damage))
    with closing(db):
        return Inspection(str(path), rows=rows_of(db))
