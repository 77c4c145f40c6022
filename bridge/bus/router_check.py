"""A router's own file, JSON5, looked through: it must be safe, and its rules those of the roles."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.bus import zenoh_settings
from bridge.bus.access import access_control
from bridge.bus.router import endpoints_of
from bridge.bus.routers import secured
from bridge.bus.zenoh_session import read_settings
from bridge.pki.identity import Identity
from bridge.pki.member import Member
from bridge.wire import keys
from bridge.wire.refusal import Refusal

_OURS_US = round(zenoh_settings.CUT_OFF_S * 1e6)
#: so many times as long is not complained of: files of earlier truerates say so
_BEARABLE = 2


@dataclass(frozen=True, slots=True)
class RouterFile:
    """What one says: where it listens, whom it joins, who it is, whom it lets in."""

    path: Path
    listen: tuple[str, ...]
    join: tuple[str, ...]
    identity: Identity | None
    members: frozenset[str]
    faults: tuple[str, ...]


def read(path: Path) -> RouterFile:
    """Read and look through a file; BusError where zenoh itself does not take it."""
    said = read_settings(str(path))
    tls = said["transport"]["link"]["tls"]
    files = [tls[name] for name in ("root_ca_certificate", "listen_certificate", "listen_private_key")]
    subjects = said["access_control"]["subjects"] or ()
    return RouterFile(
        path,
        endpoints_of(said["listen"]["endpoints"]),
        endpoints_of(said["connect"]["endpoints"]),
        Identity(*files) if all(files) else None,
        frozenset(name for subject in subjects for name in subject.get("cert_common_names") or ()),
        tuple(_faults(said)),
    )


def _faults(said: dict[str, Any]) -> Iterator[str]:
    """What is unsafe, or would make a ward fall silent."""
    if said["mode"] != "router":
        yield f"mode is {said['mode']!r}; a router's is 'router'"
    for what in ("multicast", "gossip"):
        if said["scouting"][what]["enabled"] is not False:
            yield f"scouting.{what}.enabled must be false: else this router tells the whole network that it is here"
    if said["adminspace"]["enabled"]:
        yield "adminspace.enabled must be false: else its settings can be read over the network"
    if said["timestamping"]["enabled"] is not False:
        yield "timestamping.enabled must be false: else subscribers with history drop messages"
    wait_us = said["transport"]["link"]["tx"]["queue"]["congestion_control"]["block"]["wait_before_close"]
    if wait_us > _BEARABLE * _OURS_US:
        yield f"wait_before_close is {wait_us} µs: one frozen reader silences a ward for so long; {_OURS_US} is ours"
    listen = endpoints_of(said["listen"]["endpoints"])
    if not listen:
        yield "listen.endpoints is empty: it listens nowhere"
    open_to_others = [endpoint for endpoint in listen if not secured(endpoint) and not _loopback(endpoint)]
    if open_to_others:
        yield f"{', '.join(open_to_others)}: whoever reaches it reads and commands the ward; use tls/..., or 127.0.0.1"
    if any(secured(endpoint) for endpoint in listen):
        yield from _unguarded(said)


def _unguarded(said: dict[str, Any]) -> Iterator[str]:
    tls, access = said["transport"]["link"]["tls"], said["access_control"]
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        if not tls[name]:
            yield f"transport.link.tls.{name} is missing"
    for name in ("enable_mtls", "close_link_on_expiration"):
        if not tls[name]:
            yield f"transport.link.tls.{name} must be true: else whoever has no certificate, or an expired one, is let in"
    if not access["enabled"] or access["default_permission"] != "deny":
        yield "access_control must be enabled, with default_permission 'deny': else every certificate may do everything"
        return
    if [rule for rule in access["rules"] or () if rule["permission"] != "allow"]:
        yield "access_control: a rule that denies is not needed, and is not looked through: leave out who may not"
    try:
        expected = access_control(_places(access))
    except (ValueError, Refusal) as error:
        yield f"access_control: {error}"
        return
    yield from _differing(access, expected)


def _differing(access: dict[str, Any], expected: dict[str, Any]) -> Iterator[str]:
    subjects = [{name: value for name, value in one.items() if value} for one in access["subjects"] or ()]
    if subjects != expected["subjects"]:
        yield "access_control: each subject is one common name, which is its id too, and nothing else"
    there = {rule["id"]: rule for rule in access["rules"] or ()}
    for rule in expected["rules"]:
        found = there.pop(rule["id"], None)
        if found is None:
            yield f"access_control: the rule {rule['id']!r} is missing: its holder would silently get or give nothing"
        elif any(sorted(found[name]) != sorted(rule[name]) for name in ("flows", "messages", "key_exprs")):
            yield f"access_control: the rule {rule['id']!r} is not that of its role; `truerate pki router` writes it anew"
    for name in there:
        yield f"access_control: the rule {name!r} gives somebody more than a role has"
    given = {
        policy["subjects"][0]: sorted(policy["rules"]) for policy in access["policies"] or () if policy["subjects"]
    }
    for policy in expected["policies"]:
        if given.pop(policy["subjects"][0], None) != sorted(policy["rules"]):
            yield f"access_control: the policy of {policy['subjects'][0]} does not have just its rules"
    if given or any(len(policy["subjects"]) != 1 for policy in access["policies"] or ()):
        yield "access_control: a policy is of one member each, as `truerate pki router` writes them"


def _places(access: dict[str, Any]) -> list[tuple[str, Member]]:
    """Which member the policies give rules in which ward; ValueError where a name is none."""
    wards = {rule["id"]: _ward(rule) for rule in access["rules"] or ()}
    found = {
        (wards.get(rule, ""), Member.parse(name))
        for policy in access["policies"] or ()
        for name in policy["subjects"]
        for rule in policy["rules"]
    }
    order = list(dict.fromkeys(wards.values()))
    names = [subject["id"] for subject in access["subjects"] or ()]
    known = [place for place in found if place[0] in order and place[1].common_name in names]
    return sorted(known, key=lambda place: (names.index(place[1].common_name), order.index(place[0])))


def _ward(rule: dict[str, Any]) -> str:
    """The one ward a rule is of, or nothing that could be one's name."""
    found = {
        key[len(keys.ROOT) + 1 :].partition("/")[0] for key in rule["key_exprs"] if key.startswith(f"{keys.ROOT}/")
    }
    return found.pop() if len(found) == 1 else ""


def _loopback(endpoint: str) -> bool:
    protocol, _, address = endpoint.partition("/")
    return protocol.startswith("unixsock") or address.startswith(("127.", "localhost:", "[::1]:"))
