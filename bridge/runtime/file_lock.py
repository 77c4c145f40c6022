"""Locks files among processes. The system releases a lock when its file is closed. Windows has none."""

import sys

if sys.platform != "win32":
    import fcntl


def lock(descriptor: int, *, shared: bool = False) -> bool:
    """Lock an open file, by its descriptor, without waiting; return False if another process holds it.

    shared: allow other shared locks. Windows has no locks: always True. Raises OSError where the file system has none.
    """
    if sys.platform != "win32":
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True
