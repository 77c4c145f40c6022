"""One open store: rows go in sealed, each change on disk before it is acknowledged; what comes out has a whole seal.

Where the disk fails it says so, and tries again after a while: a reader goes on from what could be read.
"""

import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Self, TypeVar

from bridge import os_words
from estimator.database.connection import FAULTS, beside, code, connect, on_file, snapshot, transaction, unused
from estimator.database.errors import Busy, StoreError, Unavailable
from estimator.database.opening import (
    ADVICE,
    LOOKED_THROUGH,
    Damaged,
    backed_up,
    head_of,
    look,
    look_through,
    migrated,
    open_store,
)
from estimator.database.rescue import file_and_log
from estimator.database.salvage import in_memory
from estimator.database.schema import SCHEMA_VERSION, TABLES, columns
from estimator.database.seal import Row, opened, sealed

log = logging.getLogger(__name__)
T = TypeVar("T")

#: after a failure, how long until the file is opened again
RETRY_S = 5.0
#: after these the connection itself is in order
_HELD = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
_PASSING = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_CONSTRAINT, *_HELD}
_MEMORY = ":memory:"
_TOLD = 1000


class Change(NamedTuple):
    """A row to be written; `conflict` says what happens to one with the same key: IGNORE keeps it, REPLACE does not."""

    table: str
    row: Row
    conflict: str = "IGNORE"


class Trim(NamedTuple):
    """All rows of a table that have `value` in `column` are removed but the `keep` written last."""

    table: str
    column: str
    value: str
    keep: int


class Database:
    """Written from one thread, read from one, the same or another.

    With `patient`, a disk that does not let us is no error but `trouble`, until it does.
    """

    def __init__(self, path: Path | str, *, patient: bool = False, clock: Callable[[], float] = time.monotonic) -> None:
        self.path = str(path)
        #: why it cannot be written now; empty when it can
        self.trouble = ""
        #: what happened to the file, for a person
        self.notes: list[str] = []
        #: rows that were asked for and had a broken seal
        self.damaged = 0
        self._clock = clock
        self._again_s = float("-inf")
        self._writable = True
        self._db: sqlite3.Connection | None = None
        #: for reading, so that nobody who reads waits for who writes; lasts as long as _db
        self._beside: sqlite3.Connection | None = None
        self._reading, self._writing = threading.RLock(), threading.RLock()
        self._together: list[Change | Trim] | None = None
        self._sick = False  # whether who reads has found that the connection is to be given up
        self._told: set[tuple[str, int]] = set()
        self._types: dict[str, dict[str, str]] = {}
        try:
            self._open()
            self._do(_try_to_write, "is it this user's to write?")
        except Unavailable as error:
            if not patient:
                raise
            self._gone(str(error))

    @classmethod
    def reading(cls, path: Path | str) -> Self:
        """A store as it is now, be it in use: nothing is written, an older schema is brought up to date in memory."""
        self = cls(_MEMORY)
        self.path = str(path)
        self.close()
        self._db, self._writable, self._again_s = _as_it_is(Path(path)), False, float("inf")
        return self

    def rows(
        self, table: str, where: str = "1", values: Sequence[object] = (), order: str = "rowid", limit: int = -1
    ) -> list[Row]:
        """Those rows whose seal is whole; the others are counted, and told once."""
        query = f"SELECT rowid AS _row, * FROM {table} WHERE {where} ORDER BY {order} LIMIT {limit}"  # noqa: S608 - our own words

        def read(db: sqlite3.Connection) -> list[Row]:
            cursor = db.execute(query, tuple(values))
            names = [name for name, *_ in cursor.description]
            found = [dict(zip(names, row, strict=True)) for row in cursor]
            return [whole for row in found if (whole := self._whole(table, int(row.pop("_row")), row)) is not None]

        hint = "restore it from a backup"
        with self._reading:
            db = self._reader()
            if db is not None:
                try:
                    return read(db)
                except FAULTS as error:
                    raise self._failed(error, hint) from error
        with self._writing, self._reading:
            return self._do(read, hint)

    @contextmanager
    def together(self) -> Iterator[None]:
        """What is written within is written at its end, all or nothing; for the thread that writes."""
        self._together = []
        try:
            yield
            changes = self._together
        finally:
            self._together = None
        self.write(*changes)

    def write(self, *changes: Change | Trim) -> None:
        """All of them, or none; on disk when it returns."""
        if self._together is not None:
            self._together += changes
            return

        def written(db: sqlite3.Connection) -> None:
            with transaction(db):
                for change in changes:
                    if isinstance(change, Change):
                        self._put(db, *change)
                    else:
                        _trimmed(db, *change)

        self._must_write(written)

    def remove(self, table: str, where: str, rows: Sequence[Sequence[object]]) -> None:
        """Take out the rows that `where` finds with each of these values: all of them, or none."""

        def removed(db: sqlite3.Connection) -> None:
            with transaction(db):
                db.executemany(f"DELETE FROM {table} WHERE {where}", [tuple(row) for row in rows])  # noqa: S608 - our own words

        self._must_write(removed)

    def probe(self) -> None:
        """Raise Unavailable unless the file can be written now."""

        def touched(db: sqlite3.Connection) -> None:
            with transaction(db):
                db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")

        self._must_write(touched)

    def backup(self, to: Path) -> None:
        """A copy of it as it is now, as a file that stands alone."""
        if to.exists():
            raise StoreError(f"{to} is there already; choose another name, or remove it")
        with self._writing:
            self._do(lambda db: backed_up(db, to), "is there room for a copy?")

    def close(self) -> None:
        """Close; what was written is on disk already."""
        with self._reading:
            if self._beside is not None:
                self._beside.close()
                self._beside = None
            if self._db is not None:
                self._db.close()
                self._db = None

    def refuse(self, table: str, words: str) -> None:
        """Count a row that has a whole seal and yet cannot be used, and tell it."""
        self.damaged += 1
        log.error("store %s: %s %s; it is not used", self.path, table, words)

    # ---- what fails -------------------------------------------------------------------------------------------------

    def _reader(self) -> sqlite3.Connection | None:
        """A connection of its own for reading; None where there is but one."""
        if self.path == _MEMORY or not self._writable or self._db is None:
            return None
        if self._beside is None:
            try:
                self._beside = connect(self.path)
                self._beside.execute("PRAGMA query_only = 1")
            except FAULTS:
                self._beside = None
        return self._beside

    def _must_write(self, work: Callable[[sqlite3.Connection], None]) -> None:
        with self._writing:
            self._write_now(work)

    def _write_now(self, work: Callable[[sqlite3.Connection], None]) -> None:
        if self._sick:
            self._sick = False
            self._gone(self.trouble)
        if not self._writable:
            if self._clock() < self._again_s:
                raise Unavailable(self.trouble or f"store {self.path} is open for reading")
            self._again_s = self._clock() + RETRY_S
            self._open()
        self._do(work, "is the disk full or read-only?")
        self.trouble = ""

    def _do(self, work: Callable[[sqlite3.Connection], T], hint: str) -> T:
        if self._db is None:
            if self._clock() < self._again_s:
                raise Unavailable(self.trouble)
            self._again_s = self._clock() + RETRY_S
            self._open()
        if self._db is None:
            raise Unavailable(self.trouble)
        try:
            return work(self._db)
        except FAULTS as error:
            raise self._failed(error, hint) from error

    def _failed(self, error: Exception, hint: str) -> Unavailable:
        """What to raise; the connection is given up, now or, while somebody writes, by who writes next."""
        self.trouble = f"store {self.path}: {error}; {hint}"
        if code(error) not in _PASSING and self.path != _MEMORY:
            if self._writing.acquire(blocking=False):
                try:
                    self._gone(self.trouble)
                finally:
                    self._writing.release()
            else:
                self._sick = True
        return Busy(self.trouble) if code(error) in _HELD else Unavailable(self.trouble)

    def _gone(self, trouble: str) -> None:
        """Go on from what can be read, for a while."""
        self.trouble = trouble
        with self._reading:
            self.close()
            self._writable, self._again_s = False, self._clock() + RETRY_S
            try:
                self._db = _as_it_is(Path(self.path))
            except StoreError as error:
                log.debug("%s", error)

    def _open(self) -> None:
        if self.path == _MEMORY:
            db = connect(_MEMORY)
            migrated(db, 0)
            notes: list[str] = []
        else:
            with self._reading:
                db, notes = self._opened_again()
        with self._reading:
            self.close()
            self._db, self._writable = db, True
        self._types = {table: columns(db, table) for table in TABLES}
        for note in notes:
            log.error("%s", note)
        self.notes += notes

    def _opened_again(self) -> tuple[sqlite3.Connection, list[str]]:
        """The file is looked at by opening and closing it, which takes all of this process's locks from it: none is held then."""
        before = self._db is not None and on_file(self._db)
        if before:
            self.close()
        try:
            return open_store(Path(self.path))
        except StoreError as error:
            self.trouble = str(error)
            if before:
                self._gone(self.trouble)
            raise

    def _put(self, db: sqlite3.Connection, table: str, row: Row, conflict: str) -> None:
        whole = sealed(table, row, self._types[table])
        places = ", ".join("?" * len(whole))
        # Not OR IGNORE, which would also pass over in silence what has no number where one must be.
        verb, but = ("INSERT", " ON CONFLICT DO NOTHING") if conflict == "IGNORE" else (f"INSERT OR {conflict}", "")
        insert = f"{verb} INTO {table} ({', '.join(whole)}) VALUES ({places}){but}"
        db.execute(insert, tuple(whole.values()))

    def _whole(self, table: str, number: int, row: dict[str, object]) -> Row | None:
        whole = opened(table, row)
        if whole is None:
            self.damaged += 1
            if (table, number) not in self._told and len(self._told) < _TOLD:
                self._told.add((table, number))
                log.error("store %s: row %d of %s is damaged and is not used", self.path, number, table)
        return whole


def _try_to_write(db: sqlite3.Connection) -> None:
    """SQLite opens what it may not write, and says so only when it is to. The file stays as it is."""
    db.execute("BEGIN IMMEDIATE")
    try:
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
    finally:
        if db.in_transaction:
            db.execute("ROLLBACK")


def _trimmed(db: sqlite3.Connection, table: str, column: str, value: str, keep: int) -> None:
    last = f"SELECT rowid FROM {table} WHERE {column} = ? ORDER BY rowid DESC LIMIT 1 OFFSET ?"  # noqa: S608 - our own words
    db.execute(f"DELETE FROM {table} WHERE {column} = ? AND rowid <= ({last})", (value, value, keep))  # noqa: S608 - our own words


def _as_it_is(path: Path) -> sqlite3.Connection:
    """What is in a store now, for reading; raises StoreError where it is missing, damaged or not ours."""
    try:
        head_of(path)
        db = _live(path)
        version = look(db, path)
        look_through(db)
        if version < SCHEMA_VERSION:
            memory = connect(_MEMORY)
            db.backup(memory)
            db.close()
            migrated(memory, version)
            return memory
    except Damaged as damage:
        raise StoreError(f"store {path} is damaged ({damage}): `truerate store check` says what is left") from damage
    except FileNotFoundError:
        raise StoreError(f"store {path}: there is no such file; {ADVICE}") from None
    except (*FAULTS, OSError) as error:
        raise StoreError(f"store {path} cannot be read: {os_words.said(error)}") from error
    return db


def _live(path: Path) -> sqlite3.Connection:
    """In step with who is writing to it; as a copy in memory where nobody is, and where nothing can be written beside it."""
    try:
        if unused(path) and path.stat().st_size <= LOOKED_THROUGH:
            return snapshot(path)  # somebody who begins to write would change it under us
        db = beside(path)
    except FAULTS:
        return in_memory(file_and_log(path))
    try:
        db.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except FAULTS:
        db.close()
        return in_memory(file_and_log(path))
    return db
