"""File locks between processes. The operating system releases a lock when its file is closed. No effect on Windows."""

import sys

if sys.platform != "win32":
    import fcntl


def lock(descriptor: int, *, shared: bool = False) -> bool:
    """Lock an open file, by its descriptor, without waiting. Return False if another process holds a conflicting lock.

    shared: True allows other shared locks. On Windows nothing is locked and the result is always True.
    Raises OSError if the file system has no locks.
    """
    if sys.platform != "win32":
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True
