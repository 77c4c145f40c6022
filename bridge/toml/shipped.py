"""Descriptions that come with truerate, by name, beside files of one's own, by path."""

from collections.abc import Iterable
from pathlib import Path

from bridge.toml.loader import ConfigError, nearest


def shipped(folders: Iterable[Path]) -> dict[str, Path]:
    """The TOML files in these folders: names and files."""
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def file_of(name: str | Path, what: str, folders: Iterable[Path]) -> Path:
    """The file of one that comes with truerate, or any that ends in .toml; ConfigError where there is no such `what`."""
    path = Path(name)
    if path.suffix == ".toml":
        return path
    known = shipped(folders)
    if str(name) not in known:
        raise ConfigError(
            f"there is no {what} {str(name)!r}; {nearest(str(name), known)} (a file of your own ends in .toml)"
        )
    return known[str(name)]
