"""Finds TOML files: shipped with truerate by name, own files by path."""

from collections.abc import Iterable
from pathlib import Path

from bridge.toml.loader import ConfigError, nearest


def shipped(folders: Iterable[Path]) -> dict[str, Path]:
    """Return the paths of the TOML files in these folders, by file name without suffix.

    The last of equal names counts.
    """
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def file_of(name: str | Path, what: str, folders: Iterable[Path]) -> Path:
    """Return the path of a shipped file by its name, or an own file's path if `name` ends in .toml.

    The own file need not exist. what: kind of file, for the error message. Raises ConfigError for an unknown name.
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
