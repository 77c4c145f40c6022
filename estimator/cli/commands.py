"""Verbs that send commands to a ward's estimator: recalibrate, cancel, zero-heading, note, forget."""

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from bridge.cli.parser import Verbs, add_device, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError
from bridge.pki.member import Role
from bridge.reasons.catalogue import english
from bridge.wire.keys import check_id
from bridge.wire.messages import CommandReply
from bridge.wire.validation import MAX_SENTENCE
from estimator.cli.ward_options import person, ward_of

if TYPE_CHECKING:
    from estimator.client import Client


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `recalibrate`, `cancel`, `zero-heading`, `note` and `forget` to the command line."""
    for name, help_text in (
        ("recalibrate", "request three new turns; the old calibration stays in use until the new one is accepted"),
        ("cancel", "cancel a running calibration; the old one stays in use"),
        ("zero-heading", "make the present heading of a device zero"),
    ):
        verb = add_verb(verbs, name, _command, help_text)
        wanted = " (default: all devices of the ward)" if name == "zero-heading" else ""
        verb.add_argument(
            "device", nargs="?" if wanted else None, help=f"device id, as `truerate devices` shows it{wanted}"
        )
        verb.add_argument("--reason", default="", help="reason, kept in the audit log with your name")
        verb.set_defaults(verb=name)
        add_ward(verb)
    verb = add_verb(
        verbs, "note", _note, "attach a text to this moment of a device; the store and running recordings keep it"
    )
    add_device(verb)
    verb.add_argument("text", help="what happened, in quotes; never a patient's name")
    add_ward(verb)
    verb = add_verb(
        verbs,
        "forget",
        _forget,
        "remove a device that has stopped sending from the ward; with --yes, delete its data from the store too",
    )
    add_device(verb, "; no bridge and no [devices] table may list it")
    verb.add_argument("--reason", default="", help="reason, kept in the audit log with your name")
    verb.add_argument(
        "--yes",
        action="store_true",
        help="delete its calibrations, boots and bias from the store for good; only the audit log is kept",
    )
    add_ward(verb)


def obey(given: argparse.Namespace, ask: Callable[["Client", str], CommandReply]) -> int:
    """Send a command for the device named in the arguments, and print the reply; returns the exit code.

    ask(client, device): sends the command and returns the reply. The exit code is 0 if the command was accepted, else
    1.
    """
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = ward_of(given, Role.COMMANDER)
    device = check_id(given.device, "device")
    with Client(endpoints, ward=ward) as client:
        return answered(device, ask(client, device))


def _forget(given: argparse.Namespace) -> int:
    return obey(given, lambda client, device: client.forget(device, person(), given.reason, erase=given.yes))


def _command(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = ward_of(given, Role.COMMANDER)
    named = [] if given.device is None else [check_id(given.device, "device")]
    with Client(endpoints, ward=ward) as client:
        ask = {"recalibrate": client.recalibrate, "cancel": client.cancel, "zero-heading": client.zero_heading}[
            given.verb
        ]
        devices = named or sorted(client.statuses())
        replies = {device: ask(device, person(), given.reason) for device in devices}
    if not replies:
        raise ConfigError(f"no device is heard in ward {ward}: is an estimator running? See `truerate devices`")
    return max([answered(device, reply) for device, reply in replies.items()])


def _note(given: argparse.Namespace) -> int:
    device, text = check_id(given.device, "device"), given.text.strip()
    if not text:
        raise ConfigError(f'the note is empty: give a text, for example truerate note {device} "sat up"')
    if len(text) > MAX_SENTENCE:
        raise ConfigError(f"the note has {len(text)} characters, at most {MAX_SENTENCE} are allowed: write two notes")
    return obey(given, lambda client, device: client.note(device, person(), text))


def answered(device: str, reply: CommandReply) -> int:
    """Print the estimator's reply to a command; returns the exit code: 0 if the command was accepted, else 1.

    device: id, printed before the reply.
    """
    print(f"{device}: {english(*reply.message)}", file=sys.stdout if reply.accepted else sys.stderr)
    return 0 if reply.accepted else 1
