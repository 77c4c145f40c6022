"""Finds TOML files: those shipped with truerate by name, a user's own files by path."""

from collections.abc import Iterable
from pathlib import Path

from bridge.toml.loader import ConfigError, nearest


def shipped(folders: Iterable[Path]) -> dict[str, Path]:
    """Return the paths of the TOML files in some folders, by file name without suffix.

    If several folders have a file of the same name, that of the last folder is returned.
    """
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def file_of(name: str | Path, what: str, folders: Iterable[Path]) -> Path:
    """Return the path of a shipped TOML file by its name; a name that ends in .toml is returned as a path.

    folders: where the shipped files are. what: kind of file, for the error message. The existence of a file given by
    path is not checked. Raises ConfigError for an unknown name.
    """
    path = Path(name)
    if path.suffix == ".toml":
        return path
    known = shipped(folders)
    if str(name) not in known:
        raise ConfigError(
            f"unknown {what} {str(name)!r}; {nearest(str(name), known)} (or give the path of your own .toml file)"
        )
    return known[str(name)]
