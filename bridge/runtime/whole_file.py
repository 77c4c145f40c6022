"""Atomic file writing: after a crash or a power failure, the file is complete, or as it was before."""

import os
import stat
import sys
from pathlib import Path

#: mode of a new file that is written for its folder's owner
_PRIVATE = 0o600


def write(path: Path, content: bytes, mode: int, owner: tuple[int, int] | None = None) -> None:
    """Replace a file's content atomically: after a crash, the file has the complete new content or the old content.

    mode: permission bits of the file, such as 0o600. owner: (user id, group id); only root may set it.
    Raises OSError if the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            if owner and sys.platform != "win32":
                os.fchown(file.fileno(), *owner)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def rewrite(path: Path, content: bytes) -> None:
    """Replace a file's content atomically, keeping its mode and, when run as root, its owner.

    A new file is readable by its owner only; when run as root, its owner is that of the folder.
    Raises OSError if the file cannot be written.
    """
    path = path.resolve()
    there = path.stat() if path.exists() else None
    like, mode = there or path.parent.stat(), stat.S_IMODE(there.st_mode) if there else _PRIVATE
    root = sys.platform != "win32" and os.geteuid() == 0
    write(path, content, mode, (like.st_uid, like.st_gid) if root else None)
