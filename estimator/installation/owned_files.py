"""Writer of an installation's files with owner and mode, which prints each action; a dry run only prints."""

import os
import pwd
import stat
from collections.abc import Callable
from pathlib import Path

from bridge.runtime import whole_file

#: user and group of the services, as made by the Debian package
USER = "truerate"
_FOLDER, _SHARED, _SECRET = 0o750, 0o640, 0o600


class OwnedFiles:
    """Writer of an installation's files, with owner and mode.

    say: prints what was done. dry: nothing is written. `changed`: files that existed with another content.
    If root installs and the services' user exists, files belong to the services' group; keys and data belong to that
    user.
    """

    def __init__(self, say: Callable[[str], None], *, dry: bool) -> None:
        self._say, self.dry = say, dry
        #: files that were there, with another content
        self.changed: list[Path] = []
        there = [one for one in pwd.getpwall() if one.pw_name == USER] if os.geteuid() == 0 else []
        self._services = there[0] if there else None

    def did(self, would: str, did: str, what: str) -> None:
        """Print an action; in a dry run as an action that would be done.

        would, did: the verb in both forms, such as `write` and `wrote`. what: the object, such as a path.
        """
        self._say(f"{f'would {would}' if self.dry else did} {what}")

    def folder(self, path: Path, *, data: bool = False) -> None:
        """Make a folder that other users cannot read; an existing folder is left as it is.

        data: whether the services write to it. Raises ValueError if every user may write to an existing one.
        """
        if path.is_dir():
            if path.stat().st_mode & stat.S_IWOTH:  # whoever may place links there chooses where keys are written
                raise ValueError(f"every user may write to {path}: run chmod o-w {path}, and check its files")
            return
        if not self.dry:
            path.mkdir(_FOLDER, parents=True, exist_ok=True)
            if owner := self._owner(user=data):
                os.chown(path, *owner)
        self.did("make", "made", f"{path}/")

    def write(self, path: Path, text: str, *, secret: bool = False) -> None:
        """Write a file atomically, readable by the services; a file with the same content is left as it is.

        secret: readable by the services' user only.
        """
        there = path.read_text("utf-8") if path.exists() else None
        if there == text:
            return
        if not self.dry:
            whole_file.write(path, text.encode(), _SECRET if secret else _SHARED, self._owner(user=secret))
        if there is not None:
            self.changed.append(path)
        self.did(*(("write", "wrote") if there is None else ("change", "changed")), str(path))

    def _owner(self, *, user: bool) -> tuple[int, int] | None:
        """User and group of what is made; None without the services' user, or where another than root installs."""
        one = self._services
        return one and (one.pw_uid if user else 0, one.pw_gid)
