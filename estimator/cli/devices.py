"""Verbs that show a running ward: devices, status, watch."""

import argparse

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.wire.keys import check_id
from estimator.cli.ward_options import listening, ward_of


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `devices`, `status` and `watch` to the command line."""
    verb = add_verb(verbs, "devices", _devices, "list every device of a running ward with state, quality and reason")
    add_ward(verb)
    verb = add_verb(
        verbs,
        "status",
        _status,
        "summarise a ward; devices that need a person come first. Exit code 1 if a device needs a person",
    )
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    add_ward(verb)
    verb = add_verb(
        verbs,
        "watch",
        _watch,
        "show a ward live (devices that need a person come first), or one device's rates and bias",
    )
    verb.add_argument("device", nargs="?", help="device id, as `truerate devices` shows it (default: the whole ward)")
    verb.add_argument("--once", action="store_true", help="print the present state once, then stop")
    verb.add_argument(
        "--json", action="store_true", help="print one JSON object per second; with --once only one object"
    )
    verb.add_argument("--seconds", type=float, default=None, help="stop after this many seconds (default: at Ctrl-C)")
    add_ward(verb)


def _devices(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    listening(given, ward)
    from estimator.terminal.watch_device import show_devices  # noqa: PLC0415

    return show_devices(plain_console(), ward, endpoints)


def _status(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    listening(given, ward)
    from estimator.terminal.watch_device import show_status  # noqa: PLC0415

    return show_status(plain_console(), ward, endpoints, as_json=given.json)


def _watch(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    if given.seconds is not None and not given.seconds > 0:
        raise ConfigError(f"--seconds is {given.seconds:g}: give a number above 0")
    if given.device is not None and not (given.once or given.json):
        from estimator.terminal.watch_device import watch  # noqa: PLC0415

        return watch(plain_console(), ward, endpoints, check_id(given.device, "device"), given.seconds)
    from estimator.client import Client  # noqa: PLC0415
    from estimator.terminal.watch_ward import watch_ward  # noqa: PLC0415

    only = "" if given.device is None else check_id(given.device, "device")
    with Client(endpoints, ward=ward) as client:
        return watch_ward(plain_console(), client, only, once=given.once, as_json=given.json, seconds=given.seconds)
