"""Check of a picture's output path, made before the computation."""

import os
from pathlib import Path

from bridge.config.schema import ConfigError

KINDS = (".png", ".svg", ".pdf")


def check(option: str, path: Path) -> None:
    """Check that a picture can be written to a path; missing folders are made later.

    option: name of the option, for the error. An existing file may be overwritten only if Matplotlib drew it, or if it
    is empty. Raises ConfigError for an unknown ending, an unusable folder, and an existing file of another kind.
    """
    if path.suffix.lower() not in KINDS:
        raise ConfigError(f"{option} {path}: unknown file type {path.suffix!r}; use {', '.join(KINDS)}")
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a folder; give a file name")
    if path.exists() and not (path.is_file() and _is_drawn(path)):
        raise ConfigError(
            f"{option} {path}: the file exists and truerate did not draw it; give another name, or remove the file"
        )
    check_folder(option, path)


def _is_drawn(path: Path) -> bool:
    """Return whether a file is a picture by Matplotlib (its name is in every format), or empty, and may be overwritten."""
    try:
        drawn = path.read_bytes()
    except OSError:
        return False
    return not drawn or b"Matplotlib" in drawn


def check_folder(option: str, path: Path) -> None:
    """Check that the folder of an output file can be written to or made.

    option: name of the option, for the error. Raises ConfigError if the folder cannot be used.
    """
    folder = next(above for above in path.absolute().parents if above.exists())
    if not folder.is_dir():
        raise ConfigError(f"{option} {path}: {folder} is not a folder; give another path")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(f"{option} {path}: no permission to write in {folder}; give another path")
