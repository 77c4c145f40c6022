"""A router's own file, JSON5, looked through: it must be safe, and its rules those of the roles."""

import ipaddress
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.bus import router_limits, zenoh_settings
from bridge.bus.access import access_control
from bridge.bus.router import endpoints_of
from bridge.bus.routers import secured
from bridge.bus.zenoh_session import TLS_INSTEAD, read_settings
from bridge.pki.member import Member
from bridge.pki.papers import Identity
from bridge.wire import keys
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.refusal import Refusal

#: what an endpoint may say behind its `#`
_ITS_OWN = ("iface", "bind", "so_sndbuf", "so_rcvbuf", "dscp")


@dataclass(frozen=True, slots=True)
class RouterFile:
    """What one says: where it listens, whom it joins, who it is, and who to those; whom it lets in, and into which ward."""

    path: Path
    id: str
    listen: tuple[str, ...]
    join: tuple[str, ...]
    identity: Identity | None
    joins_as: Identity | None
    members: frozenset[str]
    places: frozenset[tuple[str, str]]
    faults: tuple[str, ...]


def read(path: Path) -> RouterFile:
    """Read and look through a file; BusError where zenoh itself does not take it."""
    said = read_settings(str(path))
    tls = said["transport"]["link"]["tls"]
    files, others = (
        [tls[name] for name in ("root_ca_certificate", f"{way}_certificate", f"{way}_private_key")]
        for way in ("listen", "connect")
    )
    access = said["access_control"]
    return RouterFile(
        path,
        said["id"] or "",
        endpoints_of(said["listen"]["endpoints"]),
        endpoints_of(said["connect"]["endpoints"]),
        Identity(*files) if all(files) else None,
        Identity(*others) if all(others) else None,
        frozenset(name for subject in access["subjects"] or () for name in subject.get("cert_common_names") or ()),
        _who_where(access),
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
    for may, done in (("read", "read"), ("write", "changed")):
        if said["adminspace"]["permissions"][may]:
            yield f"adminspace.permissions.{may} must be false: else its settings can be {done} over the network, with zenohd"
    if said["plugins"]:
        yield f"plugins: {', '.join(said['plugins'])}: zenohd loads them, and no rule holds for what they open: leave them out"
    if said["transport"]["shared_memory"]["enabled"]:
        yield "transport.shared_memory.enabled must be false: what lies in there passes by every limit of size"
    if said["timestamping"]["enabled"] is not False:
        yield "timestamping.enabled must be false: else subscribers with history drop messages"
    tls = said["transport"]["link"]["tls"]
    if instead := [name for name in TLS_INSTEAD if tls[name]]:
        yield (
            f"transport.link.tls: {', '.join(instead)}: goes before the files, which alone are looked through: use"
            f" {', '.join(name.removesuffix('_base64') for name in instead)}"
        )
    yield from router_limits.faults(said)
    yield from _of_endpoints(said)


def _of_endpoints(said: dict[str, Any]) -> Iterator[str]:
    listen, join = (endpoints_of(said[way]["endpoints"]) for way in ("listen", "connect"))
    if not listen:
        yield "listen.endpoints is empty: it listens nowhere"
    if said["listen"]["exit_on_failure"] is False:
        yield "listen.exit_on_failure must be true: else it runs on where its port is taken, and nobody finds it"
    if join and (said["connect"]["exit_on_failure"] or said["connect"]["timeout_ms"] not in (None, -1)):
        yield "connect: timeout_ms must be -1 and exit_on_failure false: else it ends, or stays alone, while the other is away"
    yield from open_to_others(listen)
    if in_the_clear := [endpoint for endpoint in join if not secured(endpoint) and not loopback(endpoint)]:
        yield f"connect: {', '.join(in_the_clear)}: all of the ward would go there for everybody to read; use tls/..."
    taken = said["transport"]["link"]["protocols"]
    for endpoint in (*listen, *join):
        if taken and endpoint.partition("/")[0] not in taken:
            yield f"{endpoint}: transport.link.protocols has {', '.join(taken)} alone: zenoh does not take it"
        named = [one.partition("=")[0] for one in endpoint.partition("#")[2].split(";")]
        if others := [name for name in named if name and name not in _ITS_OWN]:
            yield f"{endpoint}: {', '.join(others)}: goes before what the file says for all, and is not looked through"
    if any(secured(endpoint) for endpoint in listen):
        yield from _unguarded(said)
    if any(secured(endpoint) for endpoint in join):
        yield from _unproven(said["transport"]["link"]["tls"])


def open_to_others(listen: Sequence[str]) -> Iterator[str]:
    """That whoever reaches a router there needs no certificate."""
    if reached := [endpoint for endpoint in listen if not secured(endpoint) and not loopback(endpoint)]:
        yield f"{', '.join(reached)}: whoever reaches it reads and commands the ward; use tls/..., or 127.0.0.1"


def _unproven(tls: dict[str, Any]) -> Iterator[str]:
    """What a router that joins others shows them, and asks of them."""
    for name in ("connect_certificate", "connect_private_key"):
        if not tls[name]:
            yield f"transport.link.tls.{name} is missing: the routers that it joins would not let it in"
    if not tls["verify_name_on_connect"]:
        yield "transport.link.tls.verify_name_on_connect must be true: else whoever has a certificate plays the router joined"


def _unguarded(said: dict[str, Any]) -> Iterator[str]:
    tls, access = said["transport"]["link"]["tls"], said["access_control"]
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        if not tls[name]:
            yield f"transport.link.tls.{name} is missing"
    for name in ("enable_mtls", "close_link_on_expiration"):
        if not tls[name]:
            yield f"transport.link.tls.{name} must be true: else whoever has no certificate, or an expired one, is let in"
    if not any(_limits(one) for one in said["low_pass_filter"]):
        yield f"low_pass_filter: messages of more than {MAX_PAYLOAD} bytes pass; `truerate pki router` writes it"
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
    if len(there) < len(access["rules"] or ()):
        yield "access_control: two rules have the same id: zenoh does not start with them"
    for rule in expected["rules"]:
        found = there.pop(rule["id"], None)
        if found is None:
            yield f"access_control: the rule {rule['id']!r} is missing: its holder would silently get or give nothing"
        elif any(sorted(found[name] or ()) != sorted(rule[name]) for name in ("flows", "messages", "key_exprs")):
            yield f"access_control: the rule {rule['id']!r} is not that of its role; `truerate pki router` writes it anew"
    for name in there:
        yield f"access_control: the rule {name!r} gives somebody more than a role has"
    given = sorted((policy["subjects"], sorted(policy["rules"])) for policy in access["policies"] or ())
    for policy in expected["policies"]:
        if (own := (policy["subjects"], sorted(policy["rules"]))) not in given:
            yield f"access_control: the policy of {policy['subjects'][0]} does not have just its rules"
        else:
            given.remove(own)
    if given:
        yield "access_control: each member has one policy, and each policy one member, as `truerate pki router` writes them"


def _limits(one: dict[str, Any]) -> bool:
    """Whether a filter keeps out what is too large, all of it."""
    ours = zenoh_settings.size_limit()
    wide = all(set(ours[name]) <= set(one[name] or ours[name]) for name in ("flows", "messages", "key_exprs"))
    return (
        wide and not one.get("interfaces") and not one.get("link_protocols") and one["size_limit"] <= ours["size_limit"]
    )


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


def _who_where(access: dict[str, Any]) -> frozenset[tuple[str, str]]:
    """The same by ward and common name; nothing where a name is none, which is said of already."""
    try:
        return frozenset((ward, member.common_name) for ward, member in _places(access))
    except (ValueError, Refusal):
        return frozenset()


def _ward(rule: dict[str, Any]) -> str:
    """The one ward a rule is of, or nothing that could be one's name."""
    found = {
        key[len(keys.ROOT) + 1 :].partition("/")[0] for key in rule["key_exprs"] if key.startswith(f"{keys.ROOT}/")
    }
    return found.pop() if len(found) == 1 else ""


def loopback(endpoint: str) -> bool:
    """Whether only programs of the same machine reach an endpoint."""
    protocol, _, address = endpoint.partition("/")
    host = address.partition("#")[0].partition("?")[0].rpartition(":")[0].strip("[]")
    try:
        return protocol.startswith("unixsock") or host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
