"""Writes an installation's files with owner and mode, and says what it did; a dry run only says it."""

import os
import pwd
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

#: user and group of the services, as made by the Debian package
USER = "truerate"
_FOLDER, _SHARED, _SECRET = 0o750, 0o640, 0o600


class OwnedFiles:
    """Files of an installation. Root gives them to the services' group, and keys and data to their user, if there is one."""

    def __init__(self, say: Callable[[str], None], *, dry: bool) -> None:
        self._say, self.dry = say, dry
        self._gives = os.geteuid() == 0 and any(one.pw_name == USER for one in pwd.getpwall())

    def did(self, would: str, did: str, what: str) -> None:
        """Say what was done, or would be done in a dry run."""
        self._say(f"{f'would {would}' if self.dry else did} {what}")

    def folder(self, path: Path, *, data: bool = False) -> None:
        """Make a folder that others cannot read. data: the services write to it. Raises ValueError if others may write to one."""
        if path.is_dir():
            if path.stat().st_mode & stat.S_IWOTH:  # whoever may place links there chooses where keys are written
                raise ValueError(f"every user may write to {path}: run chmod o-w {path}, and look at what is in it")
            return
        if not self.dry:
            path.mkdir(_FOLDER, parents=True, exist_ok=True)
            self._give(path, user=data)
        self.did("make", "made", f"{path}/")

    def write(self, path: Path, text: str, *, secret: bool = False) -> None:
        """Write a whole file or nothing; the services may read it. secret: their user alone may."""
        there = path.read_text("utf-8") if path.exists() else None
        if there == text:
            return
        if not self.dry:
            self._replace(path, text, secret=secret)
        self.did(*(("write", "wrote") if there is None else ("change", "changed")), str(path))

    def _replace(self, path: Path, text: str, *, secret: bool) -> None:
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        mode = _SECRET if secret else _SHARED
        try:
            with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            self._give(beside, user=secret)
            beside.replace(path)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise

    def _give(self, path: Path, *, user: bool = False) -> None:
        if self._gives:
            shutil.chown(path, USER if user else "root", USER)
