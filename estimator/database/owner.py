"""Locks of a store for one estimator; the system releases them however that estimator ends.

`owned` locks a file beside the store, before the store is checked, restored or made. `hold` locks the store's file
itself, so that a symbolic or hard link cannot bypass the lock.
"""

import errno
import logging
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.runtime import os_errors
from bridge.runtime.file_lock import lock as lock_file
from estimator.database.errors import StoreError

log = logging.getLogger(__name__)


@contextmanager
def owned(path: str) -> Iterator[None]:
    """Lock the store at `path` for the duration of a context, so that no other estimator uses the store.

    Raises StoreError if another process holds the lock, or the lock file is a symbolic link. If no file can be written
    beside the store, there is no lock, and a warning is logged.
    """
    place = Path(f"{path}.lock")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(place, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise StoreError(f"store {path}: {place} is a symbolic link: remove the link") from None
        log.warning(
            "%s: %s: truerate cannot tell whether another estimator uses the store", place, os_errors.why(error)
        )
        yield
        return
    try:
        _lock(lock, path)
        yield
    finally:
        os.close(lock)


def hold(path: Path) -> int:
    """Lock the store's file itself; returns the file descriptor that holds the lock.

    Close the descriptor after every SQLite connection to the file. Raises StoreError if another process holds the lock
    or the file is not a regular file, and OSError if it cannot be opened.
    """
    lock = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        check_regular(path, os.fstat(lock).st_mode)
        _lock(lock, str(path))
    except BaseException:
        os.close(lock)
        raise
    return lock


def check_free(path: Path) -> None:
    """Check that no other process holds the lock of a store's file; a missing file counts as free.

    Raises StoreError if another process holds the lock, or if the file is not a regular file.
    """
    try:
        os.close(hold(path))
    except FileNotFoundError:
        return


def check_regular(path: Path, mode: int) -> None:
    """Check that a store's path is a regular file. mode: `st_mode` of the path.

    Raises StoreError if it is a folder, a pipe or a device.
    """
    if not stat.S_ISREG(mode):
        raise StoreError(f"store {path} is not a regular file: give another path")


def _lock(lock: int, path: str) -> None:
    if not lock_file(lock):
        raise StoreError(f"store {path}: another estimator uses it: give each estimator its own store")
