"""Inspects a store for `truerate store check`."""

from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from estimator.database.connections import checked
from estimator.database.errors import Damaged
from estimator.database.schema import rows_of


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of a check: `fault` says why a file is not sound; `rows` counts the rows of each table of a sound one."""

    path: str
    fault: str = ""
    rows: dict[str, int] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether the content is as it was written."""
        return not self.fault


def inspect(path: Path) -> Inspection:
    """Check a store, in use or not. Raises StoreError if it does not exist or cannot be read."""
    try:
        db = checked(path)
    except Damaged as damage:
        return Inspection(str(path), str(damage))
    with closing(db):
        return Inspection(str(path), rows=rows_of(db))
