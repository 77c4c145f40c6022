"""Safe reading of files that another program may have put in place: never waits on a pipe, and limits the size."""

import errno
import os
import stat
from pathlib import Path

#: most bytes of a settings file or a certificate; the ward file of 1000 devices has about 200,000
MAX_BYTES = 1 << 20


def content(path: Path | str) -> bytes:
    """Return the bytes of a regular file of at most MAX_BYTES bytes; never waits.

    Raises OSError for a missing file, a folder, a pipe, a device, and a larger file.
    """
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(mode):
            raise OSError("this is a pipe or a device, but a file is expected")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            found = file.read(MAX_BYTES + 1)
    finally:
        os.close(descriptor)
    if len(found) > MAX_BYTES:
        raise OSError(f"the file has more than {MAX_BYTES} bytes: give another file")
    return found
