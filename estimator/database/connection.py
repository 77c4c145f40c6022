"""A connection that does nothing by itself, and transactions that are whole or not at all."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

#: what SQLite raises; words of its own about a damaged schema may not even be text
FAULTS = (sqlite3.Error, UnicodeDecodeError, OverflowError)
#: in its header a file says whether it has a log beside it
_JOURNAL, _WITHOUT_LOG = slice(18, 20), b"\1\1"
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


def on_file(db: sqlite3.Connection) -> bool:
    """Whether it is of a file, and not of memory; one that does not answer is."""
    try:
        return any(place for _, _, place in db.execute("PRAGMA database_list"))
    except sqlite3.Error:
        return True


def beside(path: Path) -> sqlite3.Connection:
    """A connection for reading that leaves nothing behind: in step with whoever writes, where anybody does."""
    alone = "&immutable=1" if unused(path) else ""
    return connect(f"{path.absolute().as_uri()}?mode=ro{alone}", uri=True)


def unused(path: Path) -> bool:
    """Whether nobody writes to it, or it would have a log."""
    return not path.with_name(path.name + "-wal").exists() or has_anothers_log(path)


def has_anothers_log(path: Path) -> bool:
    """Whether the log beside it is of a file that was there before: one that has none, a backup, was put in its place.

    SQLite would write that log into the backup.
    """
    if not path.with_name(path.name + "-wal").exists():
        return False
    try:
        with path.open("rb") as file:
            return file.read(_JOURNAL.stop)[_JOURNAL] == _WITHOUT_LOG
    except OSError:
        return False


def snapshot(path: Path) -> sqlite3.Connection:
    """All that is in it now, in memory."""
    alone, memory = unused(path), connect(":memory:")
    try:
        with closing(beside(path)) as db:
            db.backup(memory)
        if unused(path) or not alone:
            return memory
    except BaseException:
        memory.close()
        if unused(path) or not alone:
            raise
    memory.close()
    return snapshot(path)  # somebody has begun to write meanwhile: now in step with him


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
