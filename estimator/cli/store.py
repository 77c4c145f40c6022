"""The verbs about the estimator's store: history, store backup, store check, store verify, store restore."""

import argparse
import json
import re
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, load
from bridge.runtime.logs import printable
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count
from bridge.wire.keys import check_id
from bridge.wire.validation import MAX_TIME_NS
from estimator.cli import picture_file

if TYPE_CHECKING:
    from estimator.database import Backups, Inspection

HISTORY = """Shows calibrations with verdict and uncertainty, boots, commands, and the bias over time, from the estimator's store.
The estimator may be running.

examples:
  truerate history chest --config configs/ward.toml --since 7d
  truerate history chest --store truerate.sqlite3 --plot chest.png
  truerate history chest --config configs/ward.toml --json > chest.json"""
STORE = """The store is the only file of an estimator that needs a backup. A running estimator makes a backup every day, in the
folder `backups` beside the store or in `[estimator] backups`, and keeps the newest seven. Do not copy a store with `cp`: the
copy would lack the newest entries.

examples:
  truerate store backup /mnt/backup/ --config configs/ward.toml
  truerate store check --config configs/ward.toml
  truerate store check /mnt/backup/truerate-20260301T030000.sqlite3
  truerate store restore --config configs/ward.toml          # the newest valid backup; stop the estimator first
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
    """Add `history DEVICE` and `store backup|check|verify|restore`."""
    verb = add_verb(
        verbs, "history", _history, "show one device's calibrations, boots, commands and bias from the store"
    )
    verb.epilog, verb.formatter_class = HISTORY, argparse.RawDescriptionHelpFormatter
    verb.add_argument("device", help="device id as in `truerate devices`")
    verb.add_argument(
        "--since", metavar="WHEN", help="start: 7d, 12h, 2026-03-01 or 2026-03-01T14:30 (default: everything)"
    )
    verb.add_argument("--plot", type=Path, metavar="FILE", help="draw the bias over time (.png, .svg, .pdf)")
    verb.add_argument("--json", action="store_true", help="print one JSON object in SI units")
    _add_place(verb)
    parser = verbs.add_parser(
        "store",
        help="back up, check, verify or restore the estimator's store",
        description=STORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = add_verb(inner, "backup", _backup, "back up a store, also while its estimator runs")
    verb.add_argument("to", metavar="DEST", help="a folder, or a new file")
    verb.add_argument(
        "--keep", type=int, metavar="N", help="keep the newest N backups of this store in the folder, remove older ones"
    )
    _add_place(verb)
    verb = add_verb(inner, "check", _check, "check a store and its backups for damage")
    verb.add_argument("file", type=Path, nargs="?", metavar="FILE", help="a store (default: the ward's)")
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    _add_place(verb)
    does = "restore a backup into a temporary folder, open it as an estimator would, and read every calibration"
    verb = add_verb(inner, "verify", _verify, does)
    verb.add_argument("backup", type=Path, nargs="?", metavar="BACKUP", help="a backup (default: the newest one)")
    _add_place(verb)
    verb = add_verb(inner, "restore", _restore, "replace the store of a stopped estimator by a backup")
    verb.add_argument("backup", type=Path, nargs="?", metavar="BACKUP", help="a backup (default: the newest valid one)")
    _add_place(verb)


def _add_place(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--config", type=Path, help="the ward file: gives the store's path")
    verb.add_argument(
        "--store",
        type=Path,
        metavar="FILE",
        help="the store's path (default: from the ward file, else truerate.sqlite3)",
    )


def _place(given: argparse.Namespace) -> "Backups":
    """Return the paths of the store and its backups."""
    from estimator.config.schema import Estimator, Ward  # noqa: PLC0415
    from estimator.database import Backups  # noqa: PLC0415

    if given.config is None:
        return Backups.of(given.store or Estimator(id="any").store)
    ward = load(given.config, Ward)
    if ward.estimator is None:
        raise ConfigError(f"{given.config}: no [estimator] table, so no store; give --store FILE, or another ward file")
    return Backups.of(given.store or ward.estimator.store, ward.estimator.backups)


def _history(given: argparse.Namespace) -> int:
    from estimator.database import StoreError  # noqa: PLC0415
    from estimator.reports import history as report_history  # noqa: PLC0415
    from estimator.service import history  # noqa: PLC0415
    from estimator.service.store import Store  # noqa: PLC0415

    device = check_id(given.device, "device")
    if given.plot is not None:
        picture_file.check("--plot", given.plot)
    try:
        since = history.since(given.since, datetime.now().astimezone()) if given.since else None
        since_ns = min(max(0, round(since.timestamp() * 1e9)), MAX_TIME_NS) if since else 0
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"--since: {error}") from None
    store = Store.reading(_place(given).store)
    try:
        found = history.read(store, device, since_ns)
        known = [] if found else store.devices()
    finally:
        store.close()
    if given.json:
        print(json.dumps(report_history.as_json(found)))
    else:
        console = plain_console()
        for table in report_history.as_tables(found):
            console.print(table, highlight=False)
            console.print()
        if ahead := history.ahead(found, time.time_ns()):
            what = (
                f"{count(ahead, 'entry', 'entries')} of {device} {'has' if ahead == 1 else 'have'} a time in the future"
            )
            print(f"{what}: this machine's clock was wrong then, or is wrong now")
    if not found:
        when = f" since {given.since}" if given.since else ""
        others = f"it has entries of {', '.join(known)}" if known else "it has no entries yet"
        raise StoreError(f"store {store.path} has no entries of {device}{when}; {others}")
    if given.plot is not None:
        from estimator import figures  # noqa: PLC0415

        given.plot.parent.mkdir(parents=True, exist_ok=True)
        figures.history(found, given.plot, datetime.now().astimezone().tzinfo or UTC)
        if not given.json:
            print(f"picture: {given.plot}")
    return 0


def _backup(given: argparse.Namespace) -> int:
    from estimator.database import StoreError, back_up, inspect  # noqa: PLC0415

    place, to = _place(given).store, Path(given.to)
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
    if given.keep is not None:
        dated = re.compile(re.escape(place.stem) + r"-\d{8}T\d{6}" + re.escape(place.suffix))
        for old in sorted(one for one in to.parent.iterdir() if dated.fullmatch(one.name))[: -given.keep]:
            old.unlink()
            print(f"removed {old}: the newest {count(given.keep, 'backup')} are kept")
    return 0


def _verify(given: argparse.Namespace) -> int:
    from estimator.database import StoreError, inspect, restore  # noqa: PLC0415
    from estimator.service.store import Store  # noqa: PLC0415

    backups = _place(given)
    backup = given.backup or next(iter(backups.newest_first()), None)
    if backup is None:
        raise StoreError(f"there is no backup of store {backups.store} in {backups.folder}")
    with tempfile.TemporaryDirectory() as folder:
        restored = Path(folder) / backups.store.name
        restore(restored, backup)
        store = Store(restored)
        try:
            devices = store.devices()
            found = sum(len(store.calibrations(device)) for device in devices)
        finally:
            store.close()
        rows = inspect(restored).rows
    if found != rows["calibrations"]:
        raise StoreError(
            f"{backup}: only {found} of {rows['calibrations']} calibrations can be read: use another backup"
        )
    age = f"{max(0.0, time.time() - backup.stat().st_mtime) / 3600:.0f} h old"
    print(f"{backup} ({age}) can be restored: {count(len(devices), 'device')}, {count(found, 'calibration')}")
    return 0


def _check(given: argparse.Namespace) -> int:
    from estimator.database import inspect, set_asides  # noqa: PLC0415

    backups = _place(given)
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
    from estimator.database import StoreError, inspect, owned, restore  # noqa: PLC0415
    from estimator.database.owner import check_free  # noqa: PLC0415

    backups = _place(given)
    known = [given.backup] if given.backup else backups.newest_first()
    sound = next((one for one in known if inspect(one).sound), None)
    if sound is None:
        looked = given.backup or f"{count(len(known), 'backup')} in {backups.folder}"
        raise StoreError(
            f"no undamaged backup of store {backups.store}: checked {looked}; give the path of another backup"
        )
    with owned(str(backups.store)):
        check_free(backups.store)
        aside = restore(backups.store, sound)
    before = f"; the replaced file is kept as {aside}" if aside else ""
    print(f"restored {sound} as {backups.store}: {_contents(inspect(backups.store))}{before}")
    return 0


def _contents(found: "Inspection") -> str:
    return ", ".join(count(found.rows[table], *words) for table, words in _ROWS.items() if table in found.rows)
