"""The seal of a row: a digest of its table, the names of its columns and what is in them.

128 bits of BLAKE2b over MessagePack. Columns that are NULL do not count, so that a column added later breaks no seal.
"""

import hashlib
import math
from collections.abc import Mapping
from typing import Any

import msgspec

#: a row as it goes in and comes out, by column, without its seal
Row = dict[str, Any]
COLUMN = "digest"


def seal(table: str, row: Mapping[str, object]) -> bytes:
    """16 bytes that no other content of this table has."""
    content = [table, *((name, row[name]) for name in sorted(row) if row[name] is not None)]
    return hashlib.blake2b(msgspec.msgpack.encode(content), digest_size=16).digest()


def sealed(table: str, row: Row, types: Mapping[str, str]) -> dict[str, object]:
    """The row with its seal, typed as SQLite will give it back: reals are floats, one zero, NULL for what is no number."""
    typed = {name: _real(value) if types[name] == "REAL" else value for name, value in row.items()}
    return {**typed, COLUMN: seal(table, typed)}


def opened(table: str, stored: Mapping[str, object]) -> Row | None:
    """The row without its seal; None when the seal is broken."""
    row = {name: value for name, value in stored.items() if name != COLUMN}
    return row if stored[COLUMN] == seal(table, row) else None


def _real(value: Any) -> float | None:
    return None if value is None or math.isnan(value) else float(value) + 0.0
