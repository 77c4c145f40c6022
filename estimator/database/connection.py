"""A connection that does nothing by itself, and transactions that are whole or not at all."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


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
        with suppress(sqlite3.Error):  # the first error is the one to be told
            if db.in_transaction:
                db.execute("ROLLBACK")
        raise
