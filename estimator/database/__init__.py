"""A file that keeps what it was given or says that it cannot: SQLite whose rows are sealed. The only package with sqlite3."""

from estimator.database.database import Change, Database, Trim
from estimator.database.errors import Busy, StoreError, Unavailable
from estimator.database.inspection import Inspection, inspect
from estimator.database.schema import APPLICATION_ID, SCHEMA_VERSION
from estimator.database.seal import Row

__all__ = [
    "APPLICATION_ID",
    "SCHEMA_VERSION",
    "Busy",
    "Change",
    "Database",
    "Inspection",
    "Row",
    "StoreError",
    "Trim",
    "Unavailable",
    "inspect",
]
