"""Verb `truerate history`: shows one device's calibrations, boots, commands and bias from the store."""

import argparse
import json
import time
from datetime import UTC, datetime
from pathlib import Path

from bridge.cli.parser import Verbs, add_device, add_verb
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count
from bridge.wire.keys import check_id
from bridge.wire.validation import MAX_TIME_NS
from estimator.cli import picture_file
from estimator.cli.store_options import add_store, backups_of

HISTORY = """Shows calibrations with verdict and uncertainty, boots, commands, and the bias over time, from the estimator's store.
The estimator may be running.

examples:
  truerate history chest --config configs/ward.toml --since 7d
  truerate history chest --store truerate.sqlite3 --plot chest.png
  truerate history chest --config configs/ward.toml --json > chest.json"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `history DEVICE` to the command line."""
    verb = add_verb(
        verbs, "history", _history, "show one device's calibrations, boots, commands and bias from the store", HISTORY
    )
    add_device(verb)
    verb.add_argument(
        "--since", metavar="WHEN", help="start: 7d, 12h, 2026-03-01 or 2026-03-01T14:30 (default: everything)"
    )
    verb.add_argument("--plot", type=Path, metavar="FILE", help="draw the bias over time (.png, .svg, .pdf)")
    verb.add_argument("--json", action="store_true", help="print one JSON object in SI units")
    add_store(verb)


def _history(given: argparse.Namespace) -> int:
    from estimator.database import StoreError  # noqa: PLC0415
    from estimator.reports import history as report_history  # noqa: PLC0415
    from estimator.service import history  # noqa: PLC0415
    from estimator.service.store_reader import StoreReader  # noqa: PLC0415

    device = check_id(given.device, "device")
    if given.plot is not None:
        picture_file.check("--plot", given.plot)
    try:
        since = history.since(given.since, datetime.now().astimezone()) if given.since else None
        since_ns = min(max(0, round(since.timestamp() * 1e9)), MAX_TIME_NS) if since else 0
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"--since: {error}") from None
    store = StoreReader.reading(backups_of(given).store)
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
        others = f"the store has {', '.join(known)}" if known else "the store is empty"
        raise StoreError(f"store {store.path} has no entries of {device}{when}; {others}")
    if given.plot is not None:
        from estimator import figures  # noqa: PLC0415

        given.plot.parent.mkdir(parents=True, exist_ok=True)
        figures.history(found, given.plot, datetime.now().astimezone().tzinfo or UTC)
        if not given.json:
            print(f"picture: {given.plot}")
    return 0
