"""The verbs about what a ward keeps: history, store backup, store check."""

import argparse
import json
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.cli_parser import Verbs, add_verb
from bridge.config import ConfigError, load
from bridge.console import plain_console
from bridge.logs import printable
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.keys import check_id
from bridge.wording import count
from estimator import picture_file

if TYPE_CHECKING:
    from estimator.database import Inspection

HISTORY = """Calibrations with verdict and uncertainty, boots, commands, and the bias over time, from the estimator's store. The
estimator may be running meanwhile.

examples:
  truerate history chest --config configs/ward.toml --since 7d
  truerate history chest --store truerate.sqlite3 --plot chest.png
  truerate history chest --config configs/ward.toml --json > chest.json"""
STORE = """The store is the one file of an estimator that is worth a backup. Copying it with `cp` while the estimator runs loses
what is still in its log; `backup` does not.

examples:
  truerate store backup /mnt/backup/ --config configs/ward.toml
  truerate store check --config configs/ward.toml
  truerate store check /mnt/backup/truerate-20260301T030000.sqlite3"""
#: what a row of each table is, one and many
_ROWS = {
    "calibrations": ("calibration", ""),
    "boots": ("boot", ""),
    "bias": ("state to go on from", "states to go on from"),
    "bias_history": ("point of bias history", "points of bias history"),
    "audit": ("command or refusal", "commands and refusals"),
}


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `history DEVICE` and `store backup|check`."""
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
        help="back up or check what the estimator keeps",
        description=STORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = add_verb(inner, "backup", _backup, "copy the store of a running estimator into a file that stands alone")
    verb.add_argument("to", metavar="DEST", help="a folder, or a file that is not there yet")
    _add_place(verb)
    verb = add_verb(inner, "check", _check, "is the file whole, and every row in it? what is not, and what is left")
    verb.add_argument("file", type=Path, nargs="?", metavar="FILE", help="a store (default: the ward's)")
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    _add_place(verb)


def _add_place(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--config", type=Path, help="the ward's file: says where the store is")
    verb.add_argument(
        "--store", type=Path, metavar="FILE", help="the store itself (default: the file's, else truerate.sqlite3)"
    )


def _place(given: argparse.Namespace) -> Path:
    from estimator.config import Estimator, Ward  # noqa: PLC0415

    if given.store is not None:
        return Path(given.store)
    if given.config is None:
        return Path(Estimator(id="any").store)
    ward = load(given.config, Ward)
    if ward.estimator is None:
        raise ConfigError(f"{given.config}: there is no [estimator] table, so there is no store")
    return Path(ward.estimator.store)


def _history(given: argparse.Namespace) -> int:
    from estimator import history, report_history  # noqa: PLC0415
    from estimator.service.store import Store  # noqa: PLC0415

    device = check_id(given.device, "device")
    if given.plot is not None:
        picture_file.check("--plot", given.plot)
    try:
        since = history.since(given.since, datetime.now().astimezone()) if given.since else None
        since_ns = min(max(0, round(since.timestamp() * 1e9)), MAX_TIME_NS) if since else 0
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"--since: {error}") from None
    store = Store.reading(_place(given))
    try:
        found = history.read(store, device, since_ns)
        known = [] if found else history.devices(store)
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
    from estimator.database import Database, inspect  # noqa: PLC0415

    place = _place(given)
    to = Path(given.to)
    # Whoever ends it with a slash means a folder, also where it is not there, as of a stick that is not plugged in.
    if to.is_dir() or given.to.endswith("/"):
        to /= f"{place.stem}-{time.strftime('%Y%m%dT%H%M%S')}{place.suffix}"
    if not to.parent.is_dir():
        raise ConfigError(f"{to}: there is no folder {to.parent}; make it first")
    store = Database.reading(place)
    try:
        store.backup(to)
    finally:
        store.close()
    found = inspect(to)
    print(f"{place} is backed up as {to}: {_contents(found)}")
    return _damage(found)


def _check(given: argparse.Namespace) -> int:
    from estimator.database import inspect  # noqa: PLC0415

    found = inspect(given.file or _place(given))
    if given.json:
        shown = {"path": found.path, "schema": found.schema, "sound": found.sound, "faults": found.faults}
        print(json.dumps({**shown, "whole": found.whole, "damaged": found.damaged, "notes": found.notes}))
        return 0 if found.sound else 1
    print(f"{found.path}: schema {found.schema}, {_contents(found)}")
    for note in found.notes:
        print(note)
    wrong = _damage(found)
    if not wrong:
        print("every row is whole")
    elif any(found.whole.values()):
        print("what is whole can be used: the estimator takes it when it is started")
    else:
        print("nothing of it can be used: put a backup in its place, before the estimator is started")
    return wrong


def _damage(found: "Inspection") -> int:
    """Say what is not whole; the exit code."""
    for fault in found.faults:
        print(f"damaged: {printable(fault)}")
    for table, rows in found.damaged.items():
        if rows:
            print(f"damaged: {count(len(rows), 'row')} of {table}, the first is row {rows[0]}")
    return 0 if found.sound else 1


def _contents(found: "Inspection") -> str:
    return ", ".join(count(rows, *_ROWS[table]) for table, rows in found.whole.items()) or "nothing in it"
