"""SQLite store of the estimator: open, check, write, back up and restore it. No other package imports sqlite3.

Public class: `Database`.
"""

from estimator.database.backups import Backups, back_up, restore, set_asides
from estimator.database.connections import Inspection, inspect
from estimator.database.database import Database, Row
from estimator.database.errors import Damaged, StoreError, Unavailable
from estimator.database.owner import owned
from estimator.database.schema import APPLICATION_ID, SCHEMA_VERSION

__all__ = [
    "APPLICATION_ID",
    "SCHEMA_VERSION",
    "Backups",
    "Damaged",
    "Database",
    "Inspection",
    "Row",
    "StoreError",
    "Unavailable",
    "back_up",
    "inspect",
    "owned",
    "restore",
    "set_asides",
]
