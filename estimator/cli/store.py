"""The verbs about the estimator's store: history, store backup, store check, store restore."""

import argparse
import json
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

HISTORY = """Calibrations with verdict and uncertainty, boots, commands, and the bias over time, from the estimator's store. The
estimator may be running meanwhile.

examples:
  truerate history chest --config configs/ward.toml --since 7d
  truerate history chest --store truerate.sqlite3 --plot chest.png
  truerate history chest --config configs/ward.toml --json > chest.json"""
STORE = """The store is the one file of an estimator that is worth a backup. A running estimator makes one a day, in the folder
`backups` beside the store or in `[estimator] backups`, and keeps the newest seven. Do not copy a store with `cp`: what is in its
log would be missing.

examples:
  truerate store backup /mnt/backup/ --config configs/ward.toml
  truerate store check --config configs/ward.toml
  truerate store check /mnt/backup/truerate-20260301T030000.sqlite3
  truerate store restore --config configs/ward.toml          # the newest sound backup; stop the estimator first
  truerate store restore /mnt/backup/truerate-20260301T030000.sqlite3 --config configs/ward.toml"""
#: what a row of each table is called, singular and plural
_ROWS = {
    "calibrations": ("calibration", ""),
    "boots": ("boot", ""),
    "bias": ("state to go on from", "states to go on from"),
    "bias_history": ("point of bias history", "points of bias history"),
    "audit": ("command or refusal", "commands and refusals"),
}


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `history DEVICE` and `store backup|check|restore`."""
    verb = add_verb(
        verbs, "history", _history, "all that is kept of one device: calibrations, boots, commands, its bias"
    )
    verb.epilog, verb.formatter_class = HISTORY, argparse.RawDescriptionHelpFormatter
    verb.add_argument("device", help="its id, as `truerate devices` shows it")
    verb.add_argument("--since", metavar="WHEN", help="7d, 12h, 2026-03-01, 2026-03-01T14:30 (default: all of it)")
    verb.add_argument("--plot", type=Path, metavar="FILE", help="draw its bias over time (.png, .svg, .pdf)")
    verb.add_argument("--json", action="store_true", help="one JSON object, SI, in place of tables")
    _add_place(verb)
    parser = verbs.add_parser(
        "store",
        help="back up, check or restore what the estimator keeps",
        description=STORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = add_verb(inner, "backup", _backup, "copy the store of a running estimator into a file that stands alone")
    verb.add_argument("to", metavar="DEST", help="a folder, or a file that is not there yet")
    _add_place(verb)
    verb = add_verb(inner, "check", _check, "is every value in it as it was written? and is every backup?")
    verb.add_argument("file", type=Path, nargs="?", metavar="FILE", help="a store (default: the ward's)")
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    _add_place(verb)
    verb = add_verb(
        inner, "restore", _restore, "put a backup in the place of the store of an estimator that is stopped"
    )
    verb.add_argument("backup", type=Path, nargs="?", metavar="BACKUP", help="a backup (default: the newest sound one)")
    _add_place(verb)


def _add_place(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--config", type=Path, help="the ward's file: says where the store is")
    verb.add_argument(
        "--store", type=Path, metavar="FILE", help="the store itself (default: the file's, else truerate.sqlite3)"
    )


def _place(given: argparse.Namespace) -> "Backups":
    """Return the paths of the store and its backups."""
    from estimator.config.schema import Estimator, Ward  # noqa: PLC0415
    from estimator.database import Backups  # noqa: PLC0415

    if given.config is None:
        return Backups.of(given.store or Estimator(id="any").store)
    ward = load(given.config, Ward)
    if ward.estimator is None:
        raise ConfigError(f"{given.config}: there is no [estimator] table, so there is no store")
    return Backups.of(given.store or ward.estimator.store, ward.estimator.backups)


def _history(given: argparse.Namespace) -> int:
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
            what = f"{count(ahead, 'record')} of this {'lies' if ahead == 1 else 'lie'} ahead of now"
            print(f"{what}: the clock was wrong when it was written, or is wrong now")
    if not found:
        when = f" since {given.since}" if given.since else ""
        others = f"it has {', '.join(known)}" if known else "no device has been heard by its estimator yet"
        raise ConfigError(f"{store.path} has nothing of {device}{when}; {others}")
    if given.plot is not None:
        from estimator import figures  # noqa: PLC0415

        given.plot.parent.mkdir(parents=True, exist_ok=True)
        figures.history(found, given.plot, datetime.now().astimezone().tzinfo or UTC)
        if not given.json:
            print(f"drawn in {given.plot}")
    return 0


def _backup(given: argparse.Namespace) -> int:
    from estimator.database import StoreError, back_up, inspect  # noqa: PLC0415

    place, to = _place(given).store, Path(given.to)
    # A name ending in a slash is a folder even if it does not exist, as of a stick that is not plugged in.
    if to.is_dir() or given.to.endswith("/"):
        to /= f"{place.stem}-{time.strftime('%Y%m%dT%H%M%S')}{place.suffix}"
    if not to.parent.is_dir():
        raise ConfigError(f"{to}: there is no folder {to.parent}; make it first")
    if not (found := inspect(place)).sound:
        raise StoreError(found.fault)
    back_up(place, to)
    print(f"{place} is backed up as {to}: {_contents(inspect(to))}")
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
    print(printable(f"{found.path} is sound: {_contents(found)}" if found.sound else found.fault))
    for one in kept:
        made = time.strftime("%Y-%m-%d %H:%M", time.localtime(Path(one.path).stat().st_mtime))
        print(printable(f"backup {one.path} of {made}: {_contents(one) if one.sound else one.fault}"))
    for name in aside:
        print(f"{name} was set aside when it was damaged or replaced: look at it, then remove it")
    return 0 if found.sound else 1


def _restore(given: argparse.Namespace) -> int:
    from estimator.database import StoreError, inspect, owned, restore  # noqa: PLC0415
    from estimator.database.owner import check_free  # noqa: PLC0415

    backups = _place(given)
    known = [given.backup] if given.backup else backups.newest_first()
    sound = next((one for one in known if inspect(one).sound), None)
    if sound is None:
        looked = given.backup or f"{backups.folder}, which has {count(len(known), 'backup')}"
        raise StoreError(f"no sound backup of store {backups.store} is found: looked at {looked}")
    with owned(str(backups.store)):
        check_free(backups.store)
        aside = restore(backups.store, sound)
    before = f"; the file that was there is kept as {aside}" if aside else ""
    print(f"{sound} is restored as {backups.store}: {_contents(inspect(backups.store))}{before}")
    return 0


def _contents(found: "Inspection") -> str:
    return ", ".join(count(found.rows[table], *words) for table, words in _ROWS.items())
