"""A store that is damaged or torn: a copy is kept, and what is whole goes on in its place."""

import errno
import fcntl
import filecmp
import os
import shutil
import time
from contextlib import closing
from pathlib import Path

from estimator.database import salvage, wal
from estimator.database.connection import connect, has_anothers_log, transaction, unused
from estimator.database.schema import build

#: what every connection locks to read (SQLite's os_unix.c, SHARED_FIRST and SHARED_SIZE)
_SHARED, _SHARED_BYTES = 0x40000002, 510

#: what is said where a folder cannot be synchronised, as on many a network's disk: its file is in its place all the same
_NOT_OF_FOLDERS = {errno.EINVAL, errno.ENOTSUP, errno.EACCES}


def used(path: Path) -> bool:
    """Whether another process has it open now. Not to be asked while this one has: its own locks would end with the asking."""
    if not path.exists():
        return False
    with path.open("r+b") as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, _SHARED_BYTES, _SHARED)
        except BlockingIOError:
            return True
    return False


def torn(path: Path) -> list[str]:
    """What SQLite would not say: a file without content, a log that ends early. A copy is kept of what is lost by that."""
    log = path.with_name(path.name + "-wal")
    if path.exists() and path.stat().st_size == 0:
        kept = ""
        if log.exists() and not used(path):  # SQLite would remove it
            kept = f"; the log beside it, of the file that was there before, is kept as {_aside(log, path)}"
        return [f"store {path} is an empty file; a new store is begun: what it held, if anything, is lost{kept}"]
    if not log.exists() or not path.exists() or used(path):  # who has it open may just be writing
        return []
    if has_anothers_log(path):
        words = "the log beside it is of the file that was there before, and is not used"
        return [f"store {path}: {words}; it is kept as {_aside(log, path)}"]
    found = wal.read(log.read_bytes())
    if not found.lost:
        return []
    aside = _kept(path)
    words = f"of the {found.given} last writes in its log {found.lost} cannot be read"
    why = "the very last had not ended yet, or they are damaged"
    return [f"store {path}: {words} ({why}); what is before them is used, a copy of all is in {aside}"]


def rescued(path: Path, why: str) -> str:
    """Put a new store in the place of a damaged one, with every row that is whole; the damaged file is kept beside it."""
    aside = _kept(path)
    file = file_and_log(path)
    version = salvage.version_of(file[: salvage.HEAD])
    part = path.with_name(path.name + ".part")
    part.unlink(missing_ok=True)
    try:
        with closing(salvage.in_memory(file)) as damaged, closing(connect(str(part))) as fresh:
            found = salvage.scan(damaged, version)
            with transaction(fresh):
                build(fresh, version)
                for name, table in found.items():
                    salvage.put(fresh, name, table)
        replaced(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    # Only now: until it is replaced the damaged file needs its log, and the new one says in its header that it has none.
    for tail in ("-wal", "-shm"):
        path.with_name(path.name + tail).unlink(missing_ok=True)
    return f"store {path} was damaged ({why}): it is kept as {aside}, and what is whole in it goes on: {salvage.told(found)}"


def file_and_log(path: Path, end: int = -1) -> bytes:
    """The file, or so many bytes of it, as SQLite would see it: with what of its log is whole."""
    with path.open("rb") as file:
        begun = file.read(end)
    log = path.with_name(path.name + "-wal")
    return begun if unused(path) else wal.read(log.read_bytes()).onto(begun, end if end >= 0 else None)


def free(path: Path) -> Path:
    """The path, or one like it that nothing has yet."""
    number, place = 1, path
    while place.exists():
        number += 1
        place = path.with_name(f"{path.name}-{number}")
    return place


def replaced(part: Path, to: Path) -> None:
    """Rename a file that is written into its place, so that it is there after a loss of power."""
    _sync(part)
    part.replace(to)
    try:
        _sync(to.parent)
    except OSError as error:
        if error.errno not in _NOT_OF_FOLDERS:
            raise


def _kept(path: Path) -> Path:
    """A copy of the file and its log under another name: of the same, one is enough, however often it is tried."""
    for one in path.parent.iterdir():
        if one.name.startswith(f"{path.name}.damaged-") and all(_alike(path, one, tail) for tail in ("", "-wal")):
            return one
    aside = free(path.with_name(f"{path.name}.damaged-{_now()}"))
    made: list[Path] = []
    try:
        for tail in ("-wal", ""):  # the file last: as long as it is not there, the copy is not whole
            source, target = path.with_name(path.name + tail), aside.with_name(aside.name + tail)
            if source.exists():
                part = target.with_name(target.name + ".part")
                made += [part, target]
                shutil.copyfile(source, part)
                replaced(part, target)
    except BaseException:
        for one in made:  # a disk that is full must not be filled with halves
            one.unlink(missing_ok=True)
        raise
    return aside


def _aside(log: Path, path: Path) -> Path:
    """Where the log is that was beside it, moved out of its way."""
    aside = free(path.with_name(f"{path.name}.log-{_now()}"))
    replaced(log, aside)
    return aside


def _alike(path: Path, other: Path, tail: str) -> bool:
    here, there = (one.with_name(one.name + tail) for one in (path, other))
    if not here.exists() or not there.exists():
        return here.exists() == there.exists()
    return filecmp.cmp(here, there, shallow=False)


def _now() -> str:
    return time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())


def _sync(place: Path) -> None:
    handle = os.open(place, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
