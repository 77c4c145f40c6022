"""What is whole in a damaged store: its file as bytes, opened in memory, every row tried by its seal."""

import sqlite3
import struct
from dataclasses import dataclass, field
from typing import Any

from bridge.wording import count
from estimator.database.connection import FAULTS, connect
from estimator.database.schema import APPLICATION_ID, SCHEMA_VERSION, SEALED_FROM, TABLES, build, columns
from estimator.database.seal import opened

MAGIC = b"SQLite format 3\0"
_PAGE = 4096  # SQLite's own choice, and so ours
#: fields of the header (fileformat2.html, 1.3) that are the same in every store of ours, by their place
_FIXED = {20: bytes([0, 64, 32, 32]), 44: struct.pack(">I", 4), 56: struct.pack(">I", 1)}
HEADER = 100
#: enough of a file to find the words of our tables in
HEAD = 65536


@dataclass(slots=True)
class Table:
    """What could be read of one: whole rows as stored, by row id; how many had a broken seal; what stopped the reading."""

    names: list[str] = field(default_factory=list)
    rows: dict[int, tuple[Any, ...]] = field(default_factory=dict)
    broken: set[int] = field(default_factory=set)
    stopped: str = ""


def is_ours(head: bytes) -> bool:
    """Whether the beginning of a file is that of a store, damaged or not: two of its three marks are there."""
    marks = (
        head.startswith(MAGIC),
        head[68:72] == struct.pack(">I", APPLICATION_ID),
        sum(f"CREATE TABLE {table} ".encode() in head for table in TABLES) >= 2,
    )
    return sum(marks) >= 2 or (len(head) < HEADER and MAGIC.startswith(head[: len(MAGIC)]))


def header_is_whole(head: bytes) -> bool:
    """Whether those fields of a store's header that never change, are so."""
    return (
        len(head) >= HEADER
        and head[18:20] in (b"\1\1", b"\2\2")
        and all(head[at : at + len(what)] == what for at, what in _FIXED.items())
    )


def version_of(head: bytes) -> int:
    """The schema a damaged file most likely has."""
    if b"digest BLOB" not in head and b"digest TEXT" in head:
        return SEALED_FROM - 1
    (said,) = struct.unpack(">I", head[60:64].ljust(4, b"\0"))
    return int(said) if SEALED_FROM <= said <= SCHEMA_VERSION else SCHEMA_VERSION


def in_memory(file: bytes) -> sqlite3.Connection:
    """The file as a database in memory, with a header as it should be."""
    db = connect(":memory:")
    if len(file) >= _PAGE:
        db.deserialize(_mended(file))
        db.execute("PRAGMA writable_schema = ON")  # what of the schema is damaged is passed over
    return db


def scan(db: sqlite3.Connection, version: int) -> dict[str, Table]:
    """Read every table from both ends, as far as it goes."""
    fresh = connect(":memory:")
    build(fresh, version)
    found = {name: Table(list(columns(fresh, name))) for name in TABLES}
    fresh.close()
    for name, table in found.items():
        for order in ("ASC", "DESC"):
            _read(db, name, table, order, sealed=version >= SEALED_FROM)
    return found


def put(db: sqlite3.Connection, name: str, table: Table) -> None:
    """Write what was read into an empty table; what does not fit is counted as broken."""
    places = ", ".join("?" * (len(table.names) + 1))
    for rowid in sorted(table.rows):
        try:
            db.execute(
                f"INSERT INTO {name} (rowid, {', '.join(table.names)}) VALUES ({places})",  # noqa: S608 - our own words
                (rowid, *table.rows[rowid]),
            )
        except sqlite3.IntegrityError:
            del table.rows[rowid]
            table.broken.add(rowid)


def told(found: dict[str, Table]) -> str:
    """How much of each table is whole, and what is not."""
    words = ", ".join(f"{len(table.rows)} of {name}" for name, table in found.items())
    broken = sum(len(table.broken) for table in found.values())
    stopped = ", ".join(name for name, table in found.items() if table.stopped)
    words += f"; {count(broken, 'row')} damaged" if broken else ""
    return words + (f"; {stopped} cannot be read to the end" if stopped else "")


def _read(db: sqlite3.Connection, name: str, table: Table, order: str, *, sealed: bool) -> None:
    try:
        cursor = db.execute(f"SELECT rowid, {', '.join(table.names)} FROM {name} NOT INDEXED ORDER BY rowid {order}")  # noqa: S608 - our own words
        for rowid, *values in cursor:
            if rowid in table.rows or rowid in table.broken:
                if order == "DESC":
                    return  # the rest is known from the other end
                continue
            row = dict(zip(table.names, values, strict=True))
            if sealed and opened(name, row) is None:
                table.broken.add(rowid)
            else:
                table.rows[rowid] = tuple(values)
    except (*FAULTS, MemoryError) as error:
        table.stopped = str(error) or type(error).__name__


def _mended(file: bytes) -> bytes:
    """With a header as it should be, of a database without a log."""
    pages = len(file) // _PAGE
    head = bytearray(file[:HEADER])
    fields = {0: MAGIC, 16: struct.pack(">HBB", _PAGE, 1, 1), 28: struct.pack(">I", pages), 92: bytes(head[24:28])}
    for at, what in (fields | _FIXED).items():
        head[at : at + len(what)] = what
    return bytes(head) + file[HEADER : pages * _PAGE]
