"""Verb `alerts`: lists the alerts of a ward (raised, not yet cleared), acknowledges one, or sends a test message."""

import argparse
import json
import sys
from dataclasses import asdict

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError, load
from bridge.pki.member import Role
from bridge.reasons.catalogue import english
from bridge.terminal.console import plain_console
from bridge.terminal.tables import Column, Columns
from bridge.wire.keys import check_id
from estimator.cli.commands import answered
from estimator.cli.ward_options import listening, person, ward_of

_ABOUT = """Lists the standing alerts of a ward. An alert is a problem that needs a person and has lasted for its hold time.
The exit code is 1 if an alert is not acknowledged.

examples:
  truerate alerts --config configs/ward.toml                         list the alerts
  truerate alerts acknowledge chest/lost --config configs/ward.toml  state that you have seen it; `chest`: all alerts of chest
  truerate alerts test --config configs/ward.toml                    send a test message to the addresses of [alerts]"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `alerts` (list, acknowledge, test) to the command line."""
    verb = add_verb(
        verbs, "alerts", _alerts, "list problems that have needed a person for some time, or acknowledge an alert"
    )
    verb.description, verb.formatter_class = _ABOUT, argparse.RawDescriptionHelpFormatter
    verb.add_argument(
        "what",
        nargs="?",
        choices=("list", "acknowledge", "test"),
        default="list",
        help="list, acknowledge ID, or test (default: list)",
    )
    verb.add_argument(
        "id", nargs="?", metavar="ID", help="alert as in the list, such as chest/lost, or only the device"
    )
    verb.add_argument("--json", action="store_true", help="print the list as one JSON object")
    add_ward(verb)


def _alerts(given: argparse.Namespace) -> int:
    if given.what == "acknowledge" and given.id is None:
        raise ConfigError(
            "no ID: give an alert of `truerate alerts list`, such as chest/lost, or a device, such as chest"
        )
    if given.what != "acknowledge" and given.id is not None:
        raise ConfigError(f"`truerate alerts {given.what}` takes no ID: leave {given.id!r} out")
    return {"list": _list, "acknowledge": _acknowledge, "test": _test}[given.what](given)


def _acknowledge(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = ward_of(given, Role.COMMANDER)
    subject, _, kind = given.id.partition("/")
    with Client(endpoints, ward=ward) as client:
        return answered(subject, client.acknowledge(check_id(subject, "device"), person(), kind))


def _list(given: argparse.Namespace) -> int:
    from estimator.alerts.outbox import sentence  # noqa: PLC0415
    from estimator.client import Client  # noqa: PLC0415
    from estimator.reports.history import when  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    listening(given, ward)
    with Client(endpoints, ward=ward) as client:
        statuses = client.statuses()
        found = {name: status.alerts for name, status in sorted(statuses.items())}
        found |= {one.estimator: one.alerts for one in client.owned() if one.alerts}
    standing = [(name, one) for name, alerts in found.items() for one in alerts]
    if given.json:
        told = [{"id": f"{name}/{one.kind}", "subject": name, **asdict(one)} for name, one in standing]
        print(json.dumps({"ward": ward, "alerts": told}))
    elif not standing:
        print(f"ward {ward}: no alerts")
    else:
        columns = [
            Column("alert", least=16),
            Column("since", number=True),
            Column("acknowledged by"),
            Column("what", least=20),
        ]
        shown = Columns(columns)
        for name, one in standing:
            worn = statuses[name].placement if name in statuses else None
            words = english(sentence(one.kind, f"{name} ({worn})" if worn else name))
            shown.add(f"{name}/{one.kind}", when(one.since_ns), one.who, words)
        plain_console().print(shown, highlight=False)
    return 1 if any(not one.acknowledged_ns for _, one in standing) else 0


def _test(given: argparse.Namespace) -> int:
    from estimator.alerts.sender import by_apprise  # noqa: PLC0415
    from estimator.config.alerts import URLS_VARIABLE  # noqa: PLC0415
    from estimator.config.schema import Ward  # noqa: PLC0415

    if given.config is None:
        raise ConfigError("`truerate alerts test` needs the ward file: --config WARD.toml")
    ward = load(given.config, Ward)
    urls = ward.alerts.urls()
    if not urls:
        raise ConfigError(
            f"no address to send to: name a file of addresses in [alerts] urls_file, or set {URLS_VARIABLE}"
        )
    sent = by_apprise(urls)(f"{ward.ward}: test", "This is a test of the alerts of truerate.")
    print(
        f"the test message was sent; addresses: {len(urls)}"
        if sent
        else "the test message could not be sent to every address",
        file=sys.stdout if sent else sys.stderr,
    )
    return 0 if sent else 1
