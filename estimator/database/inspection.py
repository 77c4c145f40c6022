"""Inspects a store for `truerate store check`."""

from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from estimator.database.connections import checked
from estimator.database.errors import Damaged
from estimator.database.schema import rows_of


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of checking a store's file.

    fault: why the file is not sound; empty if it is. rows: number of rows by table of a sound store.
    """

    path: str
    fault: str = ""
    rows: dict[str, int] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """True if the store's content is as it was written."""
        return not self.fault


def inspect(path: Path) -> Inspection:
    """Check a store, in use or not; returns the fault or the number of rows of each table.

    Raises StoreError if the file does not exist, is not a store or cannot be read; damage is returned as a fault.
    """
    try:
        db = checked(path)
    except Damaged as damage:
        return Inspection(str(path), str(damage))
    with closing(db):
        return Inspection(str(path), rows=rows_of(db))
