"""A store is one estimator's: who has it holds a lock beside it, which the system takes back however that one ends."""

import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bridge import os_words
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
        lock = os.open(place, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        log.warning("%s: %s: whether another estimator has the store is not known", place, os_words.why(error))
        yield
        return
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            who = os.read(lock, 20).decode(errors="replace").strip()
            raise StoreError(
                f"store {path}: another estimator{f' (process {who})' if who.isdigit() else ''} has it; each needs one of its own"
            ) from None
        with suppress(OSError):  # on a full disk nobody is told who has it
            os.ftruncate(lock, 0)
            os.write(lock, str(os.getpid()).encode())
        yield
    finally:
        os.close(lock)
