"""Privacy check of a ward's files: finds those that other users of the machine can read.

Such files reveal how patients move, and who may command.
"""

import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

from estimator.config.schema import Ward

_READ, _ENTER = stat.S_IROTH, stat.S_IXOTH


def exposed(file: Path, ward: Ward) -> list[Path]:
    """Return the paths of a ward's private files that every user of this machine can read; empty if there are none.

    file: path of the ward file; it is checked only if it has password hashes. Always checked are the people file, the
    file with the addresses for alerts, the store, backups and recordings.
    """
    folders, files = list[Path](), [Path(ward.alerts.urls_file)] if ward.alerts.urls_file else []
    if ward.dashboard.people:
        files.append(file)
    if ward.dashboard.people_file:
        files.append(Path(ward.dashboard.people_file))
    if ward.estimator is not None:
        store = Path(ward.estimator.store)
        files += [store, store.with_name(f"{store.name}-wal")]
        files += _below(store.parent, f"{store.name}.aside-*")
        folders.append(Path(ward.estimator.backups or store.parent / "backups"))
    if folder := getattr(getattr(ward, "recorder", None), "folder", ""):
        folders.append(Path(folder))
    return [
        one for one in (*files, *(one for folder in folders for one in _below(folder, "*"))) if _open_to_others(one)
    ]


def advice(paths: Iterable[Path]) -> tuple[str, str]:
    """Return two texts about exposed files: the fault, and the remedy. paths: at least one."""
    first, *more = paths
    others = f" and {len(more)} more" if more else ""
    return f"every user of this machine can read {first}{others}", f"chmod o-rwx {first.parent}, or the files in it"


def _below(folder: Path, pattern: str) -> Iterator[Path]:
    try:
        yield from sorted(folder.glob(pattern))
    except OSError:
        return


def _open_to_others(path: Path) -> bool:
    """Return whether other users may read a file and enter every folder on its path."""
    try:
        real = path.resolve(strict=True)
        modes = [folder.stat().st_mode for folder in real.parents]
        return bool(real.is_file() and real.stat().st_mode & _READ and all(mode & _ENTER for mode in modes))
    except OSError:
        return False
