"""Opening a store: looked at before anything is written, brought to the present schema, put right where it is damaged."""

import sqlite3
from contextlib import closing, suppress
from functools import cache
from pathlib import Path

from bridge import os_words
from estimator.database import salvage
from estimator.database.connection import FAULTS, connect, damaged, has_anothers_log, transaction
from estimator.database.errors import StoreError, Unavailable
from estimator.database.rescue import file_and_log, free, replaced, rescued, torn, used
from estimator.database.schema import (
    APPLICATION_ID,
    MIGRATIONS,
    SCHEMA_VERSION,
    TABLES,
    build,
    described,
    mark,
)

#: a larger file is not looked through at every start but for its smaller tables; `truerate store check` does it
LOOKED_THROUGH = 256 * 2**20
#: no truerate will ever have so high a schema
_FUTURE = 1000


#: to who names a file that is none
ADVICE = "`[estimator] store` in the ward's file says where it is: --config WARD.toml, or --store FILE"


class Damaged(Exception):
    """The file is a store of ours, and not whole: what was found first."""


def open_store(path: Path) -> tuple[sqlite3.Connection, list[str]]:
    """A connection to a whole store of the present schema, and what a person should know of how it came to be whole.

    Raises StoreError where the file is not ours or too new, Unavailable where the disk does not let us.
    """
    notes: list[str] = []
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        notes += torn(path)
        if has_anothers_log(path):
            raise Unavailable(
                f"store {path} was replaced while another process has it open: stop that, then start again"
            )
        try:
            return _opened(path), notes
        except Damaged as damage:
            if used(path):  # what it still writes would go into a file that nobody has any more
                raise Unavailable(
                    f"store {path} is damaged ({damage}), and another process has it open: stop that, then start again"
                ) from None
            notes.append(rescued(path, str(damage)))
            return _opened(path), notes
    except (*FAULTS, OSError) as error:
        words = (
            f"{os_words.said(error)}; check that the folder exists, both are this user's to write, and there is room"
        )
        raise Unavailable(f"store {path}: {words}") from error
    except Damaged as damage:
        raise Unavailable(f"store {path}: damaged again at once ({damage}); is the disk failing?") from damage


def head_of(path: Path) -> bytes:
    """The beginning of a store, damaged or not; StoreError where the file is empty or of another kind, OSError without one."""
    if not path.stat().st_size:
        raise StoreError(
            f"store {path} is an empty file: nothing is kept in it. Put a backup in its place, or remove it: an estimator "
            f"that is started begins a new one"
        )
    head = file_and_log(path, salvage.HEAD)
    if not salvage.is_ours(head):
        raise StoreError(f"{path} is not a store of truerate's: {ADVICE}")
    return head


def look(db: sqlite3.Connection, path: Path | str) -> int:
    """The schema of what is open, 0 for an empty file; raises StoreError where it is not ours to read, Damaged where it is."""
    version, application = (
        int(db.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("user_version", "application_id")
    )
    there = described(db)
    ours = sum(("table", name) in {(kind, name) for kind, name, _ in there} for name in TABLES) >= 2
    if not there and version == 0 and application in (0, APPLICATION_ID):
        return 0
    if application not in (0, APPLICATION_ID) and not ours:
        raise StoreError(f"store {path} is another program's SQLite file: give the store a path of its own")
    if SCHEMA_VERSION < version < _FUTURE and application == APPLICATION_ID:
        raise StoreError(f"store {path} has schema {version}, this truerate knows {SCHEMA_VERSION}: update truerate")
    if not ours and application == 0:
        raise StoreError(f"store {path} is another program's SQLite file: give the store a path of its own")
    if application not in (0, APPLICATION_ID):
        raise Damaged("its header names another program")
    if not 1 <= version <= SCHEMA_VERSION or there != _expected(version):
        raise Damaged(f"its tables are not those of schema {version}")
    return version


def look_through(db: sqlite3.Connection, *, all_of_it: bool = True) -> None:
    """Raise Damaged unless SQLite finds every page, row and index where it should be."""
    for table in [""] if all_of_it else [f"({name})" for name in TABLES if name != "bias_history"]:
        found = [str(words) for (words,) in db.execute(f"PRAGMA integrity_check{table}")]
        if found != ["ok"]:
            raise Damaged(found[0].removeprefix("*** in database main ***\n"))


def backed_up(db: sqlite3.Connection, to: Path) -> None:
    """The database as one file that stands alone, whole or not there at all; raises Unavailable."""
    part = to.with_name(to.name + ".part")
    try:
        part.unlink(missing_ok=True)
        part.touch()  # the system says why not; SQLite does not
        with closing(connect(str(part))) as copy:
            db.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")
            look_through(copy)
        replaced(part, to)
    except (*FAULTS, OSError, Damaged) as error:
        part.unlink(missing_ok=True)
        raise Unavailable(f"store: it cannot be copied to {to}: {os_words.said(error)}") from error


def migrated(db: sqlite3.Connection, version: int) -> None:
    """Bring it to the present schema, each step in one transaction."""
    for number in range(version + 1, SCHEMA_VERSION + 1):
        with transaction(db):
            if int(db.execute("PRAGMA user_version").fetchone()[0]) < number:  # else another process was faster
                MIGRATIONS[number - 1](db)
                mark(db, number)


def _opened(path: Path) -> sqlite3.Connection:
    head = file_and_log(path, salvage.HEAD) if path.exists() else b""
    if head and not salvage.header_is_whole(head) and (salvage.is_ours(head) or len(head) < salvage.HEADER):
        if not salvage.is_ours(head):
            raise _not_ours(path)
        raise Damaged("its header is not that of a store")
    db = connect(str(path))
    try:
        version = look(db, path)
        if version:
            look_through(db, all_of_it=path.stat().st_size <= LOOKED_THROUGH)
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        if 0 < version < SCHEMA_VERSION:
            _brought_up(db, path, version)
        else:
            migrated(db, version)
    except FAULTS as error:
        db.close()
        if not damaged(error):
            raise
        if not salvage.is_ours(head):
            raise _not_ours(path) from error
        raise Damaged(str(error)) from error
    except BaseException:
        db.close()
        raise
    return db


def _brought_up(db: sqlite3.Connection, path: Path, version: int) -> None:
    """Migrate it, and keep beside it how it was; but no copy of each try from which nothing came."""
    aside = free(path.with_name(f"{path.name}.schema-{version}"))
    backed_up(db, aside)
    try:
        migrated(db, version)
    except BaseException:
        with suppress(*FAULTS, OSError):
            if int(db.execute("PRAGMA user_version").fetchone()[0]) == version:
                aside.unlink()
        raise


def _not_ours(path: Path) -> StoreError:
    return StoreError(f"store {path} is not an SQLite file: give the store a path of its own")


@cache
def _expected(version: int) -> frozenset[tuple[str, str, str | None]]:
    with closing(connect(":memory:")) as db:
        build(db, version)
        return described(db)
