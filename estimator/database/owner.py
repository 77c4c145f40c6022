"""A store is one estimator's: it holds locks, which the system takes back however that estimator ends.

`owned` locks a file beside the store, from before the store is checked, restored or made. `hold` locks the store's file itself,
so that no other name of it, a symbolic or hard link, is a way around.
"""

import errno
import fcntl
import logging
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.runtime import os_errors
from estimator.database.errors import StoreError

log = logging.getLogger(__name__)


@contextmanager
def owned(path: str) -> Iterator[None]:
    """Have a store for as long as this lasts; raises StoreError where another process has it.

    Where nothing may be written beside it nobody can tell, which is said.
    """
    place = Path(f"{path}.lock")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(place, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise StoreError(
                f"store {path}: {place} is a symbolic link, a file of its own is needed: remove it"
            ) from None
        log.warning("%s: %s: whether another estimator has the store is not known", place, os_errors.why(error))
        yield
        return
    try:
        _lock(lock, path)
        yield
    finally:
        os.close(lock)


def hold(path: Path) -> int:
    """Lock a store's file; returns its descriptor, to be closed after every connection of SQLite to it.

    Raises StoreError where another process has the file, or it is no regular file.
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
    """Raise StoreError where another process holds a store's file; there need be none."""
    try:
        os.close(hold(path))
    except FileNotFoundError:
        return


def check_regular(path: Path, mode: int) -> None:
    """Raise StoreError where a file is a folder, a pipe or a device."""
    if not stat.S_ISREG(mode):
        raise StoreError(f"store {path} is no regular file: give the store a path of its own")


def _lock(lock: int, path: str) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise StoreError(f"store {path}: another estimator has it; each needs one of its own") from None
