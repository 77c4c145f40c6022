"""Errors of a store, and their translation from errors of SQLite."""

import sqlite3

from bridge.runtime import os_errors

#: advice to a person who names a file that is no store
ADVICE = "name the ward file with --config WARD.toml, or the store with --store FILE"

#: what reading or writing a store may raise; SQLite's message on a damaged schema may not even decode
FAULTS = (sqlite3.Error, OSError, UnicodeDecodeError)
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}


class StoreError(Exception):
    """A store cannot be opened, read or written. The message names the file, the cause, and what to do."""


class Empty(StoreError):
    """A store has no entries to back up."""


class Unavailable(StoreError):
    """A store cannot be used now: the disk is full, read-only or failing, or another process holds the file."""


class Damaged(StoreError):
    """A store is damaged: its content differs from what was written. why: the damage that was found."""

    def __init__(self, path: object, why: object) -> None:
        super().__init__(f"store {path} is damaged: {why}; `truerate store restore` replaces it by a backup")
        self.why = str(why)


def translated(path: str, error: Exception) -> StoreError:
    """Return the StoreError for an error of SQLite or the operating system; it is returned, not raised.

    Damaged for corrupt content, Unavailable for a fault that may pass, else a plain StoreError. path: the store's file.
    """
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the primary result code
    no_text = isinstance(error, (UnicodeDecodeError, sqlite3.OperationalError)) and not code  # Python's own decoding
    if code in _DAMAGED or no_text:
        return Damaged(path, error)
    if isinstance(error, (sqlite3.OperationalError, OSError)) and code != sqlite3.SQLITE_ERROR:
        advice = "check that the folder exists, that this user may write to folder and file, and that the disk has room"
        return Unavailable(f"store {path}: {os_errors.said(error)}; {advice}")
    return StoreError(f"store {path}: {error}")
