"""How a store is: its schema, whether its file is whole, and every row by its seal. Nothing is written."""

import sqlite3
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from bridge import os_words
from bridge.wording import count
from estimator.database import salvage, wal
from estimator.database.connection import FAULTS, has_anothers_log, snapshot
from estimator.database.errors import StoreError
from estimator.database.opening import ADVICE, Damaged, head_of, look, look_through
from estimator.database.rescue import file_and_log
from estimator.database.schema import SCHEMA_VERSION, SEALED_FROM


@dataclass(frozen=True, slots=True)
class Inspection:
    """What was found: `faults` in words, none when all is well; whole and damaged rows of each table; `notes`, no faults."""

    path: str
    schema: int
    faults: list[str] = field(default_factory=list)
    whole: dict[str, int] = field(default_factory=dict)
    damaged: dict[str, list[int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong with it."""
        return not self.faults and not any(self.damaged.values())


def inspect(path: Path) -> Inspection:
    """Look through a store, in use or not; raises StoreError where there is none."""
    try:
        head = head_of(path)
        lost = _lost(path)
        return _inspected(path, head, [f"of its log {count(lost, 'write')} at the end cannot be read"] if lost else [])
    except FileNotFoundError:
        raise StoreError(f"store {path}: there is no such file; {ADVICE}") from None
    except OSError as error:
        raise StoreError(f"store {path} cannot be read: {os_words.said(error)}") from error


def _inspected(path: Path, head: bytes, faults: list[str]) -> Inspection:
    if not salvage.header_is_whole(head):
        faults.append("its header is damaged")
    with closing(_copy(path)) as db:
        version = salvage.version_of(head)
        try:
            if not (said := look(db, path)):
                raise Damaged("its tables are gone")
            version = said
            look_through(db)
        except (Damaged, *FAULTS) as error:
            faults.append(str(error))
        found = salvage.scan(db, version)
    faults += [f"{name} cannot be read to the end: {table.stopped}" for name, table in found.items() if table.stopped]
    return Inspection(
        str(path),
        version,
        faults,
        {name: len(table.rows) for name, table in found.items()},
        {name: sorted(table.broken) for name, table in found.items()},
        _notes(path, version),
    )


def _notes(path: Path, version: int) -> list[str]:
    notes = []
    if version < SCHEMA_VERSION:
        unsealed = ", and most rows have no seal by which they could be judged" if version < SEALED_FROM else ""
        notes.append(
            f"it is of an earlier truerate{unsealed}; an estimator that is started brings it to schema {SCHEMA_VERSION}, and"
            " keeps a copy as it is"
        )
    if has_anothers_log(path):
        notes.append("the log beside it is of the file that was there before, and is not used")
    return notes


def _lost(path: Path) -> int:
    log = path.with_name(path.name + "-wal")
    if has_anothers_log(path):
        return 0
    for wait_s in (0.0, 0.1, 0.1):  # what is being written just now is not lost
        time.sleep(wait_s)
        lost = wal.read(log.read_bytes()).lost if log.exists() else 0
        if not lost:
            break
    return lost


def _copy(path: Path) -> sqlite3.Connection:
    """What is in it now, in memory: from SQLite where it can be opened, else from its bytes."""
    try:
        return snapshot(path)
    except FAULTS:
        return salvage.in_memory(file_and_log(path))
