"""A connection that does nothing by itself, and transactions that are whole or not at all."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: what SQLite raises; words of its own about a damaged schema may not even be text
FAULTS = (sqlite3.Error, UnicodeDecodeError, OverflowError)
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}


def code(fault: Exception) -> int:
    """SQLite's primary result code of a fault."""
    return (
        int(getattr(fault, "sqlite_errorcode", 0 if isinstance(fault, sqlite3.Error) else sqlite3.SQLITE_CORRUPT))
        & 0xFF
    )


def damaged(fault: Exception) -> bool:
    """Whether it speaks of the file, and not of the disk or of us."""
    return code(fault) in _DAMAGED


def connect(path: str, *, uri: bool = False) -> sqlite3.Connection:
    """A connection that begins no transaction by itself and gives damaged text as it can."""
    db = sqlite3.connect(path, timeout=5.0, check_same_thread=False, isolation_level=None, uri=uri)
    db.text_factory = lambda raw: raw.decode("utf-8", "replace")
    return db


def beside(path: Path) -> sqlite3.Connection:
    """A connection for reading that leaves nothing behind: in step with whoever writes, where anybody does."""
    alone = "" if path.with_name(path.name + "-wal").exists() else "&immutable=1"
    return connect(f"{path.absolute().as_uri()}?mode=ro{alone}", uri=True)


@contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """All that is done within, or nothing of it, whatever is raised."""
    db.execute("BEGIN IMMEDIATE")
    try:
        yield
        db.execute("COMMIT")
    except BaseException:
        with suppress(*FAULTS):  # the first error is the one to be told
            if db.in_transaction:
                db.execute("ROLLBACK")
        raise
