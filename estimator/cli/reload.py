"""Verb `truerate reload`: checks a changed ward file, and shows which settings the running programs use."""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

from bridge.bus.contract import Bus, BusError
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import load
from bridge.config.ward_file import digest_of, member_of
from bridge.pki.member import Member, Role
from bridge.reasons.catalogue import english
from bridge.wire import keys
from bridge.wire.codec import decode_reply
from bridge.wire.messages import CommandReply
from estimator.client import Client
from estimator.config.schema import Ward

RELOAD = """Programs look at their ward file once a second. A valid change takes effect without a restart: devices, models,
enrolled devices, alerts, people, limits of the recorder. Unchanged devices keep their boots and calibrations. An invalid
file is refused as a whole (exit code 2), and the earlier settings stay in force. This command checks the file, waits for the
programs, and shows the settings that each uses; exit code 1 if a program does not use every change.

example:
  truerate reload --config configs/ward.toml"""
#: time for programs to notice a change, s, and time for one answer
_PATIENCE_S, _ANSWER_S = 4.0, 1.0
#: names of the programs that have no name of their own without a certificate
_UNNAMED = (Member(Role.COMMANDER, "dashboard"), Member(Role.RECORDER, "recorder"))


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `reload` to the command line."""
    verb = add_verb(
        verbs, "reload", _reload, "check a changed ward file, and show which settings the running programs use", RELOAD
    )
    verb.add_argument("--config", type=Path, required=True, help="the ward file")


def _reload(given: argparse.Namespace) -> int:
    ward, digest = load(given.config, Ward), digest_of(given.config)
    replies = dict[Member, CommandReply]()
    for routers in ward.bus.every():
        with ZenohBus(routers) as bus:
            replies |= dict(asked(bus, routers, ward, digest))
    for member, reply in replies.items():
        kind = "dashboard" if member.role in (Role.VIEWER, Role.COMMANDER) else member.role.value
        print(f"{' '.join(dict.fromkeys((kind, member.name)))}: {said(reply, digest)}")
    if not replies:
        print(f"{given.config} is valid. No program of ward {ward.ward} answers: is one running?")
    return 0 if replies and all(one.accepted and one.request_id == digest for one in replies.values()) else 1


def asked(
    bus: Bus, routers: Routers, ward: Ward, digest: str, patience_s: float = _PATIENCE_S
) -> Iterator[tuple[Member, CommandReply]]:
    """Ask the running programs of a ward which settings they use; yields pairs of program and reply.

    Only programs that reply are yielded. digest: checksum of the changed ward file. Each program is asked again for up
    to patience_s seconds, until its reply states this checksum.
    routers: addresses and certificate for connecting. If the certificate has another role than commander, only the
    program to which it belongs is asked.
    """
    for member in _members(bus, routers, ward):
        key, deadline = (
            keys.build(ward.ward, "config", role=member.role.value, name=member.name),
            time.monotonic() + patience_s,
        )
        runs = member.role in (Role.BRIDGE, Role.ESTIMATOR)  # it was found alive, and may be too busy to answer in time
        while (reply := _answer(bus, key)) is None or reply.request_id != digest:
            if time.monotonic() >= deadline or (reply is None and not runs):
                break
            time.sleep(0.2)
        if reply is not None:
            yield member, reply


def said(reply: CommandReply, digest: str) -> str:
    """Return a program's reply as text for a person.

    digest: checksum of the ward file asked about. The text says so if the program has read another file.
    """
    other = "" if reply.request_id == digest else "the program uses another file, not this one. Its answer: "
    return f"{other}{english(*reply.message)}"


def _members(bus: Bus, routers: Routers, ward: Ward) -> list[Member]:
    own = member_of(routers)
    if own is not None and own.role is not Role.COMMANDER:
        return [own]
    client = Client(ward=ward.ward, bus=bus)
    there = [Member(role, name) for role in (Role.BRIDGE, Role.ESTIMATOR) for name in client.alive(role.value)]
    return [*there, *((own,) if own else _UNNAMED)]


def _answer(bus: Bus, key: str) -> CommandReply | None:
    try:
        return decode_reply(bus.ask(key, b"", _ANSWER_S))
    except BusError:
        return None  # there is no such program
