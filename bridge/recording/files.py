"""Files of a recorder: NAME.mcap.part, locked, during recording; NAME.mcap when finished."""

import contextlib
import errno
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, NamedTuple

from bridge.recording.error import RecordingError
from bridge.runtime.file_lock import lock
from bridge.runtime.os_errors import why

PART = ".part"


class Finished(NamedTuple):
    """Finished recording file: its path, size and time of the last write.

    bytes: size of the file. ended_ns: host time of the last write, ns since the Unix epoch.
    """

    path: Path
    bytes: int
    ended_ns: int


class Output:
    """Recording file that is being written, under its final name plus .part.

    path: the final name. file: the open file, unbuffered and locked. Raises FileExistsError if the file exists already.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file: BinaryIO = with_part(path).open("xb", buffering=0)
        with contextlib.suppress(OSError):  # some file systems have no locks
            lock(self.file.fileno())

    def sync(self) -> None:
        """Wait until the written data is on the disk. Raises OSError if the disk fails or the file was removed."""
        os.fsync(self.file.fileno())
        if not os.fstat(self.file.fileno()).st_nlink:
            raise FileNotFoundError(f"{with_part(self.path).name} was removed while it was being written")

    def finish(self) -> None:
        """Sync and close the file, and rename it to its final name. Raises OSError if the disk fails."""
        self.sync()
        self.file.close()  # Windows renames no open file
        with_part(self.path).rename(self.path)
        sync_folder(self.path.parent)

    def discard(self) -> None:
        """Close and delete the unfinished file."""
        self.file.close()
        with_part(self.path).unlink(missing_ok=True)


class Folder:
    """Folder of a ward's recordings: creates new files, and finds unfinished and finished files.

    Raises RecordingError if the folder is missing or not writable.
    """

    def __init__(self, path: Path, ward: str) -> None:
        self.path, self._ward = path, ward
        if not path.exists():
            raise RecordingError(f"{path}: the folder does not exist; make it: mkdir -p {path}")
        if not path.is_dir():
            raise RecordingError(f"{path}: this is a file, but a folder is needed: name a folder with --out")
        if not os.access(path, os.W_OK | os.X_OK):
            raise RecordingError(
                f"{path}: no permission to write: change it (chmod u+w {path}), or name another folder with --out"
            )

    def begin(self, wall_ns: int) -> Output:
        """Create a new file WARD-TIME.mcap.part, locked for writing.

        wall_ns: UTC for the name, ns since the Unix epoch. Raises OSError if the file cannot be created.
        """
        name = f"{self._ward}-{datetime.fromtimestamp(wall_ns // 1_000_000_000, UTC):%Y%m%dT%H%M%SZ}"
        for number in range(1, 1000):
            path = self.path / f"{name}{'' if number == 1 else f'-{number}'}.mcap"
            if not path.exists():
                with contextlib.suppress(FileExistsError):
                    return Output(path)
        raise FileExistsError(
            errno.EEXIST,
            "1000 recordings of this second exist already: move some of them to another folder",
            str(self.path),
        )

    def free_bytes(self) -> int:
        """Return the number of bytes on the disk that are free for users other than root."""
        return shutil.disk_usage(self.path).free

    def leftovers(self) -> list[Path]:
        """Return the paths of this ward's unfinished files (.mcap.part) that no recorder has open."""
        return [path for path in sorted(self.path.glob(f"{self._ward}-*.mcap{PART}")) if not in_use(path)]

    def finished(self) -> list[Finished]:
        """Return this ward's finished recordings, with size and time of the last write.

        The oldest comes first, by the time in the name.
        """
        named = re.compile(re.escape(self._ward) + r"-\d{8}T\d{6}Z(-\d+)?\.mcap")
        found = []
        for path in sorted(self.path.iterdir()):
            with contextlib.suppress(OSError):  # removed meanwhile
                if named.fullmatch(path.name) and stat.S_ISREG((state := path.lstat()).st_mode):
                    found.append(Finished(path, state.st_size, state.st_mtime_ns))
        return found

    def expired(self, more_bytes: int, now_ns: int, keep_s: float, keep_bytes: float) -> Iterator[tuple[Finished, str]]:
        """Yield the recordings to delete, oldest first, each with the setting that requires it: keep_days or keep_gb.

        more_bytes: size of the recording under way; it counts towards the total size, but is never deleted.
        now_ns: host time, ns since the Unix epoch. keep_s: largest age, s, for keep_days. keep_bytes: largest total
        size, for keep_gb.
        """
        finished = self.finished()
        left = more_bytes + sum(one.bytes for one in finished)
        for one in finished:
            too_old = now_ns - one.ended_ns > keep_s * 1e9
            if not too_old and left <= keep_bytes:
                return
            left -= one.bytes
            yield one, "keep_days" if too_old else "keep_gb"

    def said(self, error: OSError) -> str:
        """Return a sentence on why a write to the folder failed, and what to do. error: raised by the write."""
        if error.errno == errno.EFBIG:
            return (
                f"the file may not grow further: raise the limit (ulimit -f), or the quota of the disk of {self.path}"
            )
        return f"{self.path} is not writable: {why(error)}"


def with_part(path: Path) -> Path:
    """Return the path of a file during recording: its final path with .part appended."""
    return path.with_name(path.name + PART)


def recorded_in(path: Path) -> str:
    """Return a sentence for the user that names a recording's path and, if unfinished, the command to recover it."""
    return f"recorded in {path}" + (
        f": complete it with truerate recording recover {path}" if path.suffix == PART else ""
    )


def check_new(paths: Iterable[Path]) -> None:
    """Check that none of the paths exists, before any file is written. Raises RecordingError if one exists."""
    for path in paths:
        if path.exists():
            raise RecordingError(
                f"{path}: exists already and is not overwritten: give another name, or remove the file"
            )


@contextlib.contextmanager
def new_file(path: Path, *, replace: bool = False) -> Iterator[BinaryIO]:
    """Open a new file for writing as a context; the file gets its name only when the block ends without an error.

    The file is then complete and on the disk. replace: True replaces an existing file.
    Raises RecordingError if the file exists already or cannot be written.
    """
    if not replace:
        check_new([path])
    unfinished = path.with_name(f".{path.name}.new")
    try:
        try:
            unfinished.unlink(missing_ok=True)  # left by a killed process; it may be a link
            with unfinished.open("x+b") as file:  # HDF5 is also read while it is written
                yield file
                file.flush()
                os.fsync(file.fileno())
            unfinished.replace(path)
            sync_folder(path.parent)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {why(error)}") from None


def in_use(path: Path) -> bool:
    """Return True if a recorder has the file open, which its lock shows; False if the file cannot be opened."""
    try:
        with path.open("rb") as file:
            return not lock(file.fileno(), shared=True)
    except OSError:
        return False


def sync_folder(path: Path) -> None:
    """Sync a folder to the disk, so that a new file name survives a power loss; errors are ignored."""
    with contextlib.suppress(OSError):
        folder = os.open(path, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
