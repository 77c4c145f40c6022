"""The verbs that show a running ward: devices, status, watch."""

import argparse

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.wire.keys import check_id
from estimator.cli.ward_options import ward_of

_ONLY = "devices in this state (degraded, awaiting-still …), or with this id (* and ? stand for anything); may be given again"


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `devices`, `status` and `watch`."""
    verb = add_verb(verbs, "devices", _devices, "every device of a running ward: state, quality, and why")
    add_ward(verb)
    verb = add_verb(
        verbs, "status", _status, "a ward at one look: who needs a person first; the exit code tells trouble"
    )
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    add_ward(verb)
    verb = add_verb(
        verbs, "watch", _watch, "a ward, live, those that need a person first; or one device's rates and bias"
    )
    verb.add_argument("device", nargs="?", help="its id, as `truerate devices` shows it (default: the whole ward)")
    verb.add_argument("--only", action="append", default=[], metavar="STATE|ID", help=_ONLY)
    verb.add_argument("--once", action="store_true", help="the ward as it is now")
    verb.add_argument("--json", action="store_true", help="a JSON object a line: one a second, or with --once one")
    verb.add_argument("--seconds", type=float, default=None, help="stop after so long (default: until Ctrl-C)")
    add_ward(verb)


def _devices(given: argparse.Namespace) -> int:
    from estimator.terminal.watch_device import show_devices  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    return show_devices(plain_console(), ward, endpoints)


def _status(given: argparse.Namespace) -> int:
    from estimator.terminal.watch_device import show_status  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    return show_status(plain_console(), ward, endpoints, as_json=given.json)


def _watch(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    if given.seconds is not None and not given.seconds > 0:
        raise ConfigError(f"--seconds is {given.seconds:g}; more than 0 is taken")
    if given.device is not None and not (given.only or given.once or given.json):
        from estimator.terminal.watch_device import watch  # noqa: PLC0415

        return watch(plain_console(), ward, endpoints, check_id(given.device, "device"), given.seconds)
    from estimator.client import Client  # noqa: PLC0415
    from estimator.terminal.watch_ward import watch_ward  # noqa: PLC0415

    only = [*given.only, *([check_id(given.device, "device")] if given.device is not None else [])]
    with Client(endpoints, ward=ward) as client:
        return watch_ward(plain_console(), client, only, once=given.once, as_json=given.json, seconds=given.seconds)
