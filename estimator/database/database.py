"""Open store, written by one thread and read by any thread. A failure is reported, and the next write tries again."""

import logging
import os
import sqlite3
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from estimator.database.backups import Backups, make_sound, rescue
from estimator.database.connections import Connect, checked, to_read, to_write
from estimator.database.errors import FAULTS, Damaged, Empty, StoreError, Unavailable, translated
from estimator.database.owner import check_free, hold
from estimator.database.schema import create

log = logging.getLogger(__name__)

#: a row of a table, by column
Row = dict[str, Any]
_MEMORY = ":memory:"


class Database:
    """Open store (SQLite file) and its backups. One thread may write, any thread may read.

    path: the store's file, or `:memory:`. backups: folder of the backups, by default `backups` beside the store.
    alone: True allows no other process to open the store for writing.
    patient: True raises no error if the file cannot be opened or read; `trouble` states the cause, and queries return
    no rows. connect: sqlite3.connect, or a test's substitute.

    Raises StoreError if the file is not a store, and Unavailable if it cannot be opened.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        patient: bool = False,
        backups: Path | str | None = None,
        alone: bool = False,
        connect: Connect = sqlite3.connect,
    ) -> None:
        self.path = str(path)
        #: why the store cannot be written now; empty if it can
        self.trouble = ""
        #: why the latest backup that was due was not made; empty when it was
        self.backup_fault = ""
        #: for a person: what happened each time the file was not sound
        self.notes: list[str] = []
        #: number of failed reads and writes
        self.failures = 0
        self._backups = Backups.of(path, backups)
        self._connect, self._patient = connect, patient
        self._writer: sqlite3.Connection | None = None
        self._reader: sqlite3.Connection | None = None
        self._damaged = self._read_only = self._within = False
        #: device and inode of the open file; whether its place holds another file, or none; its lock
        self._file: tuple[int, int] | None = None
        self._moved, self._alone = False, alone
        self._lock: int | None = None
        try:
            self._writer = self._opened()
        except Unavailable as error:
            if not patient:
                raise
            self._failed(error)

    @classmethod
    def reading(cls, path: Path | str) -> Self:
        """Open a store for reading only, in use or not. Raises StoreError if it is not an intact store."""
        self = cls(_MEMORY)
        self.close()
        self.path, self._read_only = str(path), True
        self._reader = checked(Path(path))
        return self

    def close(self) -> None:
        """Close the store; everything written is on disk already."""
        reader, writer, self._reader, self._writer = self._reader, self._writer, None, None
        for db in (reader, writer):  # the last connection to close merges the log into the file
            if db is not None:
                db.close()
        if (
            self._lock is not None
        ):  # after SQLite's: closing any descriptor of a file ends the process's own locks on it
            os.close(self._lock)
            self._lock = None

    # ---- reading ----------------------------------------------------------------------------------------------------

    def rows(
        self, table: str, where: str = "1", values: Sequence[object] = (), order: str = "number", limit: int = -1
    ) -> list[Row]:
        """Return the rows of a table that fulfil a condition, as dicts by column.

        where: SQL condition with a `?` for each of `values`. order: SQL columns to sort by. limit: largest number of
        rows; negative for all. Raises StoreError if the query fails; a patient database returns an empty list instead.
        """
        return self.select(f"SELECT * FROM {table} WHERE {where} ORDER BY {order} LIMIT {limit}", values)  # noqa: S608 - our own words

    def select(self, sql: str, values: Sequence[object] = ()) -> list[Row]:
        """Return the rows that an SQL query finds, as dicts by column.

        values: one for each `?` of the query. Raises StoreError if the query fails; a patient database returns an empty
        list instead.
        """
        try:
            with self._telling():
                if self._reader is None or self._damaged:
                    raise Unavailable(self.trouble or f"store {self.path} is not open")
                cursor = self._reader.execute(sql, tuple(values))
                names = [name for name, *_ in cursor.description]
                return [dict(zip(names, row, strict=True)) for row in cursor]
        except StoreError:
            if self._patient:
                return []
            raise

    # ---- writing ----------------------------------------------------------------------------------------------------

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Open a transaction as a context: all its statements are written, or none; they are on disk at its end.

        A transaction inside another belongs to the outer one. Raises StoreError if the store cannot be written.
        """
        if self._within:
            yield
            return
        with self._telling():
            db = self._to_write()
            db.execute("BEGIN IMMEDIATE")
            self._within = True
            try:
                yield
                db.execute("COMMIT")
            except BaseException:
                with suppress(
                    sqlite3.Error
                ):  # the first error is the one to report; SQLite may have rolled back by itself
                    db.execute("ROLLBACK")
                if db.in_transaction:
                    self._writer = None
                    db.close()
                raise
            finally:
                self._within = False
        self._worked()

    def execute(self, sql: str, values: Sequence[object] | Mapping[str, object] = ()) -> int:
        """Execute an SQL statement that writes; returns the number of rows changed.

        values: for the placeholders of the statement. A statement outside a `transaction` is a transaction of its own.
        Raises StoreError if the store cannot be written.
        """
        with self._telling():
            changed = self._to_write().execute(sql, values).rowcount
        if not self._within:
            self._worked()
        return changed

    def insert(self, table: str, row: Row, conflict: str = "") -> None:
        """Add a row to a table.

        row: values by column. conflict: SQL that follows the row, such as `ON CONFLICT DO NOTHING`. Raises StoreError
        if the store cannot be written.
        """
        places = ", ".join("?" * len(row))
        self.execute(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({places}) {conflict}", tuple(row.values()))  # noqa: S608 - our own words

    def look(self) -> None:
        """Check that the open file is still at its path, and set `trouble` if not; the next write then restores the file.

        Callable from any thread.
        """
        if self._file is None or self._moved:
            return
        try:
            moved = _identity(Path(self.path)) != self._file
        except FileNotFoundError:
            moved = True
        except OSError:  # the disk is away: writing will report it
            return
        if moved:
            self._moved = True
            self._failed(Unavailable(f"store {self.path} was removed or replaced while it is in use"))

    def back_up_if_due(self) -> None:
        """Make a backup if the newest one is older than 23 hours; callable from any thread.

        A failure is logged and kept in `backup_fault`. Damage that the backup finds is repaired by the next write.
        """
        if self.path == _MEMORY:
            return
        try:
            if self._backups.due(time.time()):
                log.info("store %s is backed up as %s", self.path, self._backups.make())
            self.backup_fault = ""
        except Empty:
            self.backup_fault = ""  # the first entries are backed up within the hour
        except Damaged as damage:
            self._failed(damage)
        except StoreError as error:
            self.failures += 1
            self.backup_fault = str(error)
            log.error("no backup of store %s is made: %s", self.path, error)

    # ---- opening, and what fails ------------------------------------------------------------------------------------

    def _to_write(self) -> sqlite3.Connection:
        """Return the writing connection, reopened or rescued if necessary."""
        if self._moved and not self._within and self._writer is not None:
            with self._telling():
                if self._alone:
                    _see_that_it_is_free(Path(self.path))
                aside = rescue(self._writer, Path(self.path))
            self.close()
            self._moved, self._file = False, None
            kept = f"; what was there instead is kept as {aside}" if aside else ""
            self.notes.append(
                f"store {self.path} was removed or replaced while it was in use, and is written anew{kept}"
            )
            log.error("%s", self.notes[-1])
        if self._damaged and not self._within:
            self.close()
            self._damaged = False
        if self._writer is None:
            try:
                self._writer = self._opened()
            except StoreError as error:
                self._failed(Unavailable(str(error)))
                raise Unavailable(self.trouble) from error
        return self._writer

    def _opened(self) -> sqlite3.Connection:
        """Return a writing connection to a sound file; `_reader` is opened too, even if the file is read-only."""
        if self._read_only:
            raise StoreError(f"store {self.path} is open only for reading")
        path = Path(self.path)
        try:
            if self.path == _MEMORY:
                memory = self._reader = to_write(_MEMORY, self._connect)
                create(memory)
                return memory
            if self._reader is None:
                if note := make_sound(path, self._backups):
                    self.notes.append(note)
                    log.error("%s", note)
                if self._alone and self._lock is None:
                    self._lock = hold(path)
                self._reader = to_read(path)
            writer = to_write(path, self._connect)
            before, self._reader = self._reader, to_read(path)  # opened again, to be in step with the writer
            before.close()
            self._file = _identity(path)
        except FAULTS as error:
            raise translated(self.path, error) from error
        return writer

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Translate an error of SQLite or of the system into a StoreError, and record it."""
        try:
            yield
        except FAULTS as error:
            found = translated(self.path, error)
            self._failed(found)
            raise found from error

    def _worked(self) -> None:
        if self.trouble:
            self.trouble = ""
            log.warning("store %s works again", self.path)

    def _failed(self, error: StoreError) -> None:
        self.failures += 1
        if isinstance(error, (Damaged, Unavailable)):
            if not self.trouble:
                log.error("%s; the estimator continues from memory and tries again", error)
            self.trouble = str(error)
        self._damaged |= isinstance(error, Damaged)


def _see_that_it_is_free(path: Path) -> None:
    try:
        check_free(path)
    except StoreError as error:  # the other process may end
        raise Unavailable(str(error)) from error


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_dev, found.st_ino
