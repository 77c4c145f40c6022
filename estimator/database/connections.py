"""SQLite connections to a store: one to write, any number to read, and the check that comes before either."""

import logging
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path

from estimator.database.errors import ADVICE, FAULTS, Damaged, StoreError, translated
from estimator.database.owner import check_regular
from estimator.database.schema import APPLICATION_ID, check

log = logging.getLogger(__name__)

#: opens a connection, with the parameters of sqlite3.connect
Connect = Callable[..., sqlite3.Connection]

#: a check that takes longer is said, s
SLOW_S = 2.0
_MAGIC, _APPLICATION = b"SQLite format 3\0", slice(68, 72)


def to_write(path: Path | str, connect: Connect = sqlite3.connect) -> sqlite3.Connection:
    """A connection whose commits are on disk when they return, and that begins no transaction by itself."""
    db = connect(str(path), timeout=5.0, isolation_level=None, check_same_thread=False)
    try:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        db.execute("BEGIN IMMEDIATE")  # fails at once where the file may only be read
        db.execute("ROLLBACK")
    except BaseException:
        db.close()
        raise
    return db


def to_read(path: Path) -> sqlite3.Connection:
    """A connection that writes nothing, and leaves no file beside a store that nobody has open."""
    alone = "" if log_of(path).exists() else "&immutable=1"
    uri = f"{path.absolute().as_uri()}?mode=ro{alone}"
    return sqlite3.connect(uri, uri=True, timeout=5.0, isolation_level=None, check_same_thread=False)


def checked(path: Path, *, ours: bool = False) -> sqlite3.Connection:
    """A connection to read a store that is whole.

    ours: whether the file is known to be a store even where its header is damaged.

    Raises Damaged where the file is not as it was written, StoreError where it is no store, Unavailable where it cannot be read.
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
                raise Damaged(path, "it is an empty file")
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
            found = StoreError(f"{path} is not a store of truerate's: {ADVICE}")
        raise found from error
    return db


def log_of(path: Path) -> Path:
    """SQLite's write-ahead log of a store."""
    return path.with_name(path.name + "-wal")


def _is_ours(path: Path) -> bool:
    """Whether a file that is not whole was a store, by its header."""
    with path.open("rb") as file:
        head = file.read(_APPLICATION.stop)
    return _MAGIC.startswith(head[: len(_MAGIC)]) or head[_APPLICATION] == APPLICATION_ID.to_bytes(4, "big")
