"""Verb `truerate cluster status`: lists the estimators of a ward and their devices.

Each device is listed with the estimator that owns it: only this estimator processes the device's samples.
"""

import argparse
from datetime import datetime

from rich.text import Text

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.ward_options import add_ward
from bridge.reasons.catalogue import english
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count
from bridge.terminal.tables import Column, Columns
from estimator.cli.ward_options import listening, ward_of
from estimator.overview.cluster import ClusterView, as_json, cluster_view


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `cluster status` to the command line."""
    inner = verbs.add_parser(
        "cluster",
        help="show the estimators that share a ward",
        description="Example: truerate cluster status --config ward.toml",
    ).add_subparsers(metavar="VERB", required=True)
    verb = add_verb(
        inner, "status", _status, "show the live estimators, their devices, and the latest moves of devices"
    )
    verb.add_argument("--devices", action="store_true", help="list every device with its estimator and epoch")
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    add_ward(verb)


def _status(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    listening(given, ward)
    from estimator.client import Client  # noqa: PLC0415

    with Client(endpoints, ward=ward) as client:
        alive = client.alive("estimator")
        view = cluster_view(ward, alive, client.owned())
    console = plain_console()
    if given.json:
        console.print_json(data=as_json(view))
        return int(bool(view.troubles))
    for shown in _words(view, devices=given.devices):
        console.print(shown, highlight=False)
    return int(bool(view.troubles))


def _words(view: ClusterView, *, devices: bool) -> list[Text | Columns]:
    shares = Columns(
        [
            Column("estimator", least=16),
            Column("devices", number=True),
            Column("load", number=True, spare=2),
            Column("latest move", spare=1, least=20),
        ]
    )
    for share in view.shares:
        last = share.moves[-1] if share.moves else None
        moved = f"{_clock(last.time_ns)} {_moved(last.came, last.left)}: {english(*last.reason)}" if last else ""
        shares.add(
            share.estimator if share.alive else f"{share.estimator} (gone)",
            str(len(share.holdings)),
            f"{share.load:.0%}",
            moved,
        )
    alive = sum(share.alive for share in view.shares)
    title = f"{view.ward}: {count(len(view.devices), 'device')}, {count(alive, 'estimator')}"
    shown: list[Text | Columns] = [Text(title, "bold"), shares]
    shown += [Text(english(trouble), "bold red") for trouble in view.troubles]
    if devices:
        table = Columns(
            [Column("device", least=20), Column("estimator", least=16), Column("epoch", number=True, spare=1)]
        )
        for name, (estimator, holding) in view.devices.items():
            table.add(name, estimator, str(holding.epoch))
        shown.append(table)
    return shown


def _moved(came: int, left: int) -> str:
    return f"{count(came, 'device')} came" if came else f"{count(left, 'device')} left"


def _clock(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / 1e9).astimezone().strftime("%H:%M:%S")
