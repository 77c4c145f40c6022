"""Check of a router's zenoh configuration file (JSON5): every difference from the file that truerate would write is a fault.

The comparison uses the endpoints and members in the checked file.
"""

import ipaddress
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.bus import router_file
from bridge.bus.embedded_router import endpoints_of
from bridge.bus.routers import secured
from bridge.bus.zenoh_session import read_settings, with_defaults
from bridge.pki.certificate_files import Identity
from bridge.pki.member import Member
from bridge.wire import keys
from bridge.wire.refusal import Refusal

#: endpoint options (after `#`) that do not weaken security
_HARMLESS = ("iface", "bind", "so_sndbuf", "so_rcvbuf", "dscp")
#: paths of the settings that each site chooses itself, which are not compared
_OWN = (".id", ".listen.endpoints", ".connect.endpoints")
_SHORT = 80  # characters; longer values are not shown


@dataclass(frozen=True, slots=True)
class RouterFile:
    """Content of a router's zenoh configuration file, and the faults found in it.

    path: the file. listen: endpoints to listen on. join: endpoints of other routers to connect to. identity: paths of
    the certificate files; None without TLS.
    places: pairs (ward, common name), one for each member in the access rules. faults: sentences; empty if there are
    none.
    """

    path: Path
    listen: tuple[str, ...]
    join: tuple[str, ...]
    identity: Identity | None
    places: frozenset[tuple[str, str]]  # ward, common name
    faults: tuple[str, ...]

    @property
    def members(self) -> frozenset[str]:
        """Common names (in certificates) of all members in the access rules."""
        return frozenset(name for _, name in self.places)


def read(path: Path) -> RouterFile:
    """Read a router's zenoh configuration file and check it against the file that truerate would write.

    Raises BusError if zenoh cannot read the file. All other faults are listed in the result.
    """
    said = read_settings(str(path))
    listen, join = (endpoints_of(said[way]["endpoints"]) for way in ("listen", "connect"))
    tls = said["transport"]["link"]["tls"]
    files = [tls[name] for name in ("root_ca_certificate", "listen_certificate", "listen_private_key")]
    identity = Identity(*files) if all(files) else None
    places: list[tuple[str, Member]] = []
    faults = list(_of_endpoints(listen, join))
    try:
        places = _places(said["access_control"])
        if any(map(secured, listen)) and identity is None:
            faults.append(
                "transport.link.tls: root_ca_certificate, listen_certificate and listen_private_key are needed"
            )
        else:
            guarded = any(map(secured, listen)) and identity
            ours = router_file.guarded(listen, guarded, places, join) if guarded else router_file.plain(listen, join)
            faults += _differing("", said, with_defaults(ours))
    except (ValueError, Refusal) as error:
        faults.append(f"access_control: {error}")
    return RouterFile(
        path, listen, join, identity, frozenset((ward, one.common_name) for ward, one in places), tuple(faults)
    )


def open_to_others(listen: Sequence[str]) -> Iterator[str]:
    """Yield one sentence if other machines can reach an endpoint without a certificate, else nothing.

    listen: endpoints on which a router listens.
    """
    if reached := [endpoint for endpoint in listen if not secured(endpoint) and not loopback(endpoint)]:
        yield f"{', '.join(reached)}: every machine in reach can read and command the ward; use tls/..., or 127.0.0.1"


def loopback(endpoint: str) -> bool:
    """Return True if a zenoh endpoint can be reached only from the same machine."""
    protocol, _, address = endpoint.partition("/")
    host = address.partition("#")[0].partition("?")[0].rpartition(":")[0].strip("[]")
    try:
        return protocol.startswith("unixsock") or host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _of_endpoints(listen: Sequence[str], join: Sequence[str]) -> Iterator[str]:
    if not listen:
        yield "listen.endpoints is empty: add one, such as 'tls/0.0.0.0:7447'"
    yield from open_to_others(listen)
    if in_the_clear := [endpoint for endpoint in join if not secured(endpoint) and not loopback(endpoint)]:
        yield f"connect: {', '.join(in_the_clear)}: the ward's data would travel unencrypted; use tls/..."
    for endpoint in (*listen, *join):
        named = [one.partition("=")[0] for one in endpoint.partition("#")[2].split(";")]
        if others := [name for name in named if name and name not in _HARMLESS]:
            yield f"{endpoint}: {', '.join(others)}: overrides the settings for all endpoints: remove it"


def _differing(where: str, said: Any, ours: Any) -> Iterator[str]:
    """Yield a sentence per differing setting, beginning with the setting's name. Lists of tables are compared by id."""
    if where in _OWN:
        return
    if isinstance(said, dict) or isinstance(ours, dict):
        there, wanted = (one if isinstance(one, dict) else {} for one in (said, ours))
        for name in dict.fromkeys((*there, *wanted)):
            yield from _differing(f"{where}.{name}", there.get(name), wanted.get(name))
    elif _tables(said) and _tables(ours):
        there, wanted = _by_id(said or []), _by_id(ours or [])
        if len(there) < len(said or []):
            yield f"{where[1:]}: two entries have the same id or the same member: remove one"
        for name in dict.fromkeys((*there, *wanted)):
            if name not in wanted:
                yield f"{where[1:]}: {name} is unknown to truerate: remove it"
            elif name not in there:
                yield f"{where[1:]}: {name} is missing: write the file again with `truerate pki router`"
            else:
                yield from _differing(f"{where}[{name}]", there[name], wanted[name])
    elif _plain(said) != _plain(ours):
        has, expected = json.dumps(said), json.dumps(ours)
        if len(has + expected) < _SHORT:
            yield f"{where[1:]} is {has}, but {expected} is expected: write the file again with `truerate pki router`"
        else:
            yield f"{where[1:]} is not what `truerate pki router` writes: write the file again"


def _tables(value: Any) -> bool:
    return value is None or (isinstance(value, list) and all(isinstance(one, dict) for one in value))


def _by_id(tables: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {str(one.get("id") or one.get("subjects") or at): one for at, one in enumerate(tables)}


def _plain(value: Any) -> Any:
    """Return a zenoh setting ready to compare: lists sorted, an empty list as None, as in zenoh."""
    return (sorted(value, key=str) or None) if isinstance(value, list) else value


def _places(access: dict[str, Any]) -> list[tuple[str, Member]]:
    """Return (ward, member) pairs from the policies, in the file's order. Raises ValueError for an invalid common name."""
    wards = {rule["id"]: _ward(rule) for rule in access["rules"] or ()}
    found = {
        (ward, Member.parse(name)): None
        for policy in access["policies"] or ()
        for name in policy["subjects"]
        for rule in policy["rules"]
        if (ward := wards.get(rule))
    }
    return list(found)


def _ward(rule: dict[str, Any]) -> str:
    """Return the ward in a rule's first key; empty if that key belongs to no ward."""
    first = str(next(iter(rule["key_exprs"] or ()), ""))
    return first.removeprefix(f"{keys.ROOT}/").partition("/")[0] if first.startswith(f"{keys.ROOT}/") else ""
