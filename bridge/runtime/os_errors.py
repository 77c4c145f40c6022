"""Operating system errors in plain words, without error numbers or names of constants."""

import errno
import os
import stat
from pathlib import Path

_WORDS = {
    errno.EISDIR: "a folder, but a file is expected",
    errno.ENOTDIR: "a part of its path is a file, not a folder",
    errno.ENOENT: "there is no such file or folder",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.EROFS: "the disk is read-only",
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk's quota is exhausted",
    errno.ENAMETOOLONG: "the name is too long",
    errno.EADDRINUSE: "in use by another program",
    errno.EADDRNOTAVAIL: "not an address of this machine",
    errno.EMFILE: "this program has too many files open",
}


def why(error: OSError) -> str:
    """Return the cause of an OSError in plain words, for use after a file name.

    An error without an error number gives its own message.
    """
    if error.errno is None:
        return str(error)
    return _WORDS.get(error.errno) or (error.strerror or str(error)).lower()


def sentence(error: OSError) -> str:
    """Return a text with the file name of an OSError, if it has one, and the cause in plain words."""
    return why(error) if error.filename is None else f"{os.fsdecode(error.filename)}: {why(error)}"


def said(error: Exception) -> str:
    """Return the text of any exception; for an OSError, its file name and cause as in `sentence`."""
    return sentence(error) if isinstance(error, OSError) else str(error)


def unreadable(path: Path) -> str:
    """Return in plain words why a file cannot be read; "" if it can be read. Does not open the file."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "there is no such file"
    except OSError as error:
        return why(error)
    if stat.S_ISDIR(mode):
        return _WORDS[errno.EISDIR]
    if not stat.S_ISREG(mode):
        return "not a file"
    return "" if os.access(path, os.R_OK) else "no permission to read it"
