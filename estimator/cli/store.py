"""Verbs for the estimator's store: store backup, store check, store verify, store restore."""

import argparse
import json
import os
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.cli.parser import Verbs, add_group, add_verb
from bridge.config.schema import ConfigError, load
from bridge.runtime.logs import printable
from bridge.runtime.regular_file import content
from bridge.runtime.whole_file import rewrite
from bridge.terminal.plurals import count
from bridge.terminal.progress import Bar
from estimator.cli.store_options import add_store, backups_of

if TYPE_CHECKING:
    from estimator.database import Backups, Inspection

STORE = """The store is the only file of an estimator that needs a backup. A running estimator makes a backup every day, in the
folder `backups` beside the store or in `[estimator] backups`, and keeps the newest seven. Do not copy a store with `cp`: the
copy would lack the newest entries. With --config, `store backup` also copies the `people_file` that the ward file names, and
`store restore` restores those people if the ward lists nobody.

examples:
  truerate store backup /mnt/backup/ --config configs/ward.toml
  truerate store check --config configs/ward.toml
  truerate store check /mnt/backup/truerate-20260301T030000.sqlite3
  truerate store restore --config configs/ward.toml          # the newest valid backup; stop the estimator first
  truerate store restore --s3 --config configs/ward.toml     # the same, from the bucket of [s3]
  truerate store restore /mnt/backup/truerate-20260301T030000.sqlite3 --config configs/ward.toml"""
#: what a row of each table is called, singular and plural
_ROWS = {
    "calibrations": ("calibration", ""),
    "boots": ("boot", ""),
    "bias": ("saved state", ""),
    "bias_history": ("bias history point", ""),
    "audit": ("command", ""),
    "placements": ("placement", ""),
    "alerts": ("alert", ""),
}


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `store backup|check|verify|restore` to the command line."""
    inner = add_group(verbs, "store", "back up, check, verify or restore the estimator's store", about=STORE)
    verb = add_verb(inner, "backup", _backup, "back up a store, also while its estimator runs")
    verb.add_argument("to", metavar="DEST", help="a folder, or a new file")
    verb.add_argument(
        "--keep", type=int, metavar="N", help="keep the newest N backups of this store in the folder, remove older ones"
    )
    add_store(verb)
    verb = add_verb(inner, "check", _check, "check a store and its backups for damage")
    verb.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="store to check (default: that of the ward file)"
    )
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    add_store(verb)
    for name, run, what in (
        (
            "verify",
            _verify,
            "restore a backup into a temporary folder, open it as an estimator would, and read every calibration",
        ),
        ("restore", _restore, "replace the store of a stopped estimator by a backup"),
    ):
        verb = add_verb(inner, name, run, what)
        verb.add_argument(
            "backup", type=Path, nargs="?", metavar="BACKUP", help="backup to use (default: the newest valid backup)"
        )
        verb.add_argument("--s3", action="store_true", help="take BACKUP, by its name, from the bucket of [s3]")
        add_store(verb)


def _backup(given: argparse.Namespace) -> int:
    from estimator.config.people_file import people_in  # noqa: PLC0415 - tomlkit is slow to import
    from estimator.database import StoreError, back_up, inspect  # noqa: PLC0415

    place, to = backups_of(given).store, Path(given.to)
    # A name ending in a slash is a folder even if it does not exist, as of a stick that is not plugged in.
    if into_folder := to.is_dir() or given.to.endswith("/"):
        to /= f"{place.stem}-{time.strftime('%Y%m%dT%H%M%S')}{place.suffix}"
    if given.keep is not None and (given.keep < 1 or not into_folder):
        raise ConfigError("--keep is the number of backups in a folder: give 1 or more, and a folder as DEST")
    if not to.parent.is_dir():
        raise ConfigError(f"{to}: there is no folder {to.parent}; make it with mkdir -p, or give another folder")
    if not (found := inspect(place)).sound:
        raise StoreError(found.fault)
    back_up(place, to)
    print(f"backed up {place} as {to}: {_contents(inspect(to))}")
    if (paths := _people(given, to.parent)) and people_in(paths[0]):
        rewrite(paths[1], content(paths[0]))
        print(f"backed up {paths[0]} as {paths[1]}")
    if given.keep is not None:
        dated = re.compile(re.escape(place.stem) + r"-\d{8}T\d{6}" + re.escape(place.suffix))
        for old in sorted(one for one in to.parent.iterdir() if dated.fullmatch(one.name))[: -given.keep]:
            old.unlink()
            print(f"removed {old}: the newest {count(given.keep, 'backup')} are kept")
    return 0


def _verify(given: argparse.Namespace) -> int:
    from estimator.database import StoreError, inspect, restore  # noqa: PLC0415
    from estimator.service.store import Store  # noqa: PLC0415

    backups = backups_of(given)
    with tempfile.TemporaryDirectory() as folder:
        backup, restored = next(_candidates(given, backups, Path(folder)), None), Path(folder) / "restored.sqlite3"
        if backup is None:
            where = "the bucket" if given.s3 else backups.folder
            raise StoreError(
                f"there is no backup of store {backups.store} in {where}: make one with `truerate store backup`"
            )
        restore(restored, backup)
        store = Store(restored)
        try:
            devices = store.devices()
            found = sum(len(store.calibrations(device)) for device in devices)
        finally:
            store.close()
        rows, age_s = inspect(restored).rows, max(0.0, time.time() - backup.stat().st_mtime)
    if found != rows["calibrations"]:
        raise StoreError(
            f"{backup}: only {found} of {rows['calibrations']} calibrations can be read: use another backup"
        )
    contents = f"{count(len(devices), 'device')}, {count(found, 'calibration')}"
    print(f"{_shown(given, backup)} ({age_s / 3600:.0f} h old) can be restored: {contents}")
    return 0


def _check(given: argparse.Namespace) -> int:
    from estimator.database import inspect, set_asides  # noqa: PLC0415

    backups = backups_of(given)
    found = inspect(given.file or backups.store)
    kept = [] if given.file else [inspect(one) for one in backups.newest_first()]
    aside = [] if given.file else [str(one) for one in set_asides(backups.store)]
    if given.json:
        shown = {"path": found.path, "sound": found.sound, "fault": found.fault, "rows": found.rows}
        print(json.dumps({**shown, "backups": {one.path: one.sound for one in kept}, "set_aside": aside}))
        return 0 if found.sound else 1
    print(printable(f"{found.path} is undamaged: {_contents(found)}" if found.sound else found.fault))
    for one in kept:
        made = time.strftime("%Y-%m-%d %H:%M", time.localtime(Path(one.path).stat().st_mtime))
        print(printable(f"backup {one.path} of {made}: {_contents(one) if one.sound else one.fault}"))
    for name in aside:
        print(f"{name} is a store that was damaged or replaced: inspect it, then remove it")
    return 0 if found.sound else 1


def _restore(given: argparse.Namespace) -> int:
    from estimator.config.people_file import people_in  # noqa: PLC0415 - as above
    from estimator.database import StoreError, inspect, owned, restore  # noqa: PLC0415
    from estimator.database.owner import check_free  # noqa: PLC0415

    backups, looked = backups_of(given), list[Path]()
    with tempfile.TemporaryDirectory() as folder, owned(str(backups.store)):
        check_free(backups.store)
        for one in _candidates(given, backups, Path(folder)):
            looked.append(one)
            if inspect(one).sound:
                aside = restore(backups.store, one)
                break
        else:
            where = given.backup or f"{count(len(looked), 'backup')} in {'the bucket' if given.s3 else backups.folder}"
            raise StoreError(
                f"no undamaged backup of store {backups.store}: checked {where}; give the path of another backup"
            )
    before = f"; the replaced file is kept as {aside}" if aside else ""
    print(f"restored {_shown(given, one)} as {backups.store}: {_contents(inspect(backups.store))}{before}")
    # People who are listed stay: the copy may hold some who were removed since.
    if (paths := _people(given, one.parent)) and paths[1].exists() and not people_in(paths[0]):
        rewrite(paths[0], content(paths[1]))
        print(f"restored {paths[1]} as {paths[0]}")
    return 0


def _people(given: argparse.Namespace, folder: Path) -> tuple[Path, Path] | None:
    """Return the ward's `people_file`, and the path of its copy in a folder of backups; None without a `people_file`."""
    from estimator.config.schema import Ward  # noqa: PLC0415

    ward = load(given.config, Ward) if given.config else None
    if ward is None or not ward.dashboard.people_file:
        return None
    return Path(ward.dashboard.people_file), folder / f"{ward.ward}-people.toml"


def _candidates(given: argparse.Namespace, backups: "Backups", folder: Path) -> Iterator[Path]:
    """Yield the named backup, or all, the newest first. With --s3 each is copied from the bucket into a folder."""
    if not given.s3:
        yield from [given.backup] if given.backup else backups.newest_first()
        return
    from bridge.bucket.bucket import Bucket  # noqa: PLC0415
    from estimator.config.schema import Ward  # noqa: PLC0415
    from estimator.database.backups import copies_of  # noqa: PLC0415

    ward = load(given.config, Ward) if given.config else None
    if ward is None or ward.s3 is None or ward.estimator is None:
        raise ConfigError("--s3 needs a ward file with the tables [s3] and [estimator]: give --config WARD.toml")
    bucket, place = Bucket(ward.s3, ward.ward), copies_of(ward.estimator.id)
    with Bar() as bar:
        for made, name, _ in bucket.copies(place):
            if "/" not in name and given.backup in (None, Path(name)):
                bucket.download(f"{place}/{name}", to := folder / name, bar.on(name))
                os.utime(to, (made.timestamp(),) * 2)
                yield to


def _shown(given: argparse.Namespace, backup: Path) -> str:
    return f"{backup.name} of the bucket" if given.s3 else str(backup)


def _contents(found: "Inspection") -> str:
    return ", ".join(count(found.rows[table], *words) for table, words in _ROWS.items() if table in found.rows)
