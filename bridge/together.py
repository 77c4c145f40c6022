"""Whether the files of a ward go together: ids, endpoints, certificates, and what routers know of them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from bridge.bus.router_check import RouterFile, loopback, open_to_others
from bridge.bus.routers import Routers, secured
from bridge.config import LOCAL, Root, Router, check_endpoints, clash
from bridge.pki.identity import by_authority, member_of
from bridge.pki.identity import faults as identity_faults
from bridge.pki.member import Member, Role
from bridge.routers_together import faults as router_faults
from bridge.routers_together import host_of, hosts_at, is_for, port_of, reaches, trusts

#: what all estimators of a ward are told alike
_NAMED = 5
_ALIKE = ("method", "model", "models", "horizontal_turns", "warming_s", "silence_s")


def faults(wards: Mapping[Path, Root], routers: Sequence[RouterFile], now: datetime) -> list[str]:
    """All that is wrong, each a sentence that begins with the file; `now` judges the certificates."""
    return [
        *(f"{router.path}: {words}" for router in routers for words in _of_router(router, now)),
        *(f"{path}: {words}" for path, root in wards.items() for words in _of_ward(root, now)),
        *_strangers(wards),
        *(() if routers else _on_one_machine(wards)),
        *router_faults(routers),
        *_twice(wards),
        *_otherwise(wards),
        *(f"{path}: {words}" for path, root in wards.items() if routers for words in _between(root, routers)),
    ]


def soon(wards: Mapping[Path, Root], routers: Sequence[RouterFile]) -> Iterator[str]:
    """What is right and will not be so within days, each a sentence that begins with the file."""
    for path, root in wards.items():
        yield from (f"{path}: [bus]: {words}" for words in root.bus.routers.soon())
    for router in routers:
        yield from (f"{router.path}: {words}" for words in Routers(router.listen, router.identity).soon())


def unused(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Devices given a model of their own that are not there, as far as these files tell; sentences as above."""
    for path, root in wards.items():
        if root.devices is not None:
            there, so = set(root.devices.read()), "enrolled: its model is of no use"
        else:
            there = _listed(wards.values(), root.ward)
            so = "in [[bridge.devices]]: its model is of no use, unless another bridge has it"
        models: Mapping[str, str] = root.estimator.models if root.estimator is not None and there else {}
        for device in sorted(models.keys() - there):
            close = get_close_matches(device, there, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            yield f"{path}: [estimator]: models: {device!r} is not {so}{hint}"


def _listed(roots: Iterable[Root], ward: str) -> set[str]:
    """The devices of all bridges of a ward."""
    return {device.id for root in roots if root.ward == ward and root.bridge for device in root.bridge.devices}


def _of_router(router: RouterFile, now: datetime) -> Iterator[str]:
    yield from router.faults
    for key, endpoints in {"listen.endpoints": router.listen, "connect.endpoints": router.join}.items():
        try:
            check_endpoints(endpoints or (LOCAL,), key)
        except ValueError as error:
            yield str(error)
    if router.identity is not None:
        yield from identity_faults(router.identity, now, (Role.ROUTER,))
        if by_authority(router.identity):
            yield (
                f"root_ca_certificate: {router.identity.ca} is the authority's own: whose certificate was revoked would still"
                " get a session; the file that `truerate pki router` writes beside the certificates ends in .members.pem"
            )
    if router.join and router.joins_as not in (None, router.identity):
        yield from identity_faults(router.joins_as, now, (Role.ROUTER,))


def _of_ward(root: Root, now: datetime) -> Iterator[str]:
    ports = {port_of(endpoint) for endpoint in root.router.listen}
    if root.router != Router() and not ports & {port_of(endpoint) for endpoint in root.bus.connect}:
        there, here = ", ".join(root.router.listen), ", ".join(root.bus.connect)
        yield f"[router] listens at {there}, and [bus] connects to {here}: is one of the ports mistaken?"
    yield from (f"[router]: listen: {words}" for words in open_to_others(root.router.listen))
    if root.bus.identity is None:
        return
    wrong = identity_faults(root.bus.identity, now, tuple(role for role in Role if role is not Role.ROUTER))
    yield from (f"[bus]: {words}" for words in wrong)
    if (member := _member(root)) is None:
        return
    # One certificate may stand in a file that says more of the ward; but not for somebody else of its role.
    tables = {Role.BRIDGE: root.bridge, Role.ESTIMATOR: root.estimator}
    table: Any = tables.get(member.role)
    if member.role in tables and (table is None or table.id != member.name):
        there = f"its id is {table.id!r}" if table is not None else "there is none"
        yield f"[bus]: the certificate is for {member.label}; of [{member.role.value}] {there}"


def _strangers(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Devices of a bridge that an estimator of its ward, of another file or the same, would not use."""
    for path, root in wards.items():
        if root.devices is None:
            continue
        places = root.devices.read()
        for there, other in wards.items():
            if other.bridge is None or other.ward != root.ward or (other is not root and root.estimator is None):
                continue
            where = "" if other is root else f" in {there}"
            for device in other.bridge.devices:
                if places.get(device.id, other.bridge.id) not in ("", other.bridge.id):
                    by = f"is enrolled by {places[device.id]!r}, and listed by {other.bridge.id!r}"
                    yield f"{path}: [devices]: {device.id!r} {by}{where}"
                elif device.id not in places:
                    yield (
                        f"{path}: [devices]: {device.id!r} of [[bridge.devices]]{where} is not enrolled: the estimator would"
                        " not use it"
                    )


def _on_one_machine(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Files of a ward whose programs go to routers of their own machine: to the same, and each listens at a port of its own."""
    first: dict[str, tuple[Path, Sequence[str]]] = {}
    taken: list[tuple[Path, str, str]] = []
    stores: dict[tuple[str, Path], Path] = {}
    for path, root in wards.items():
        here = root.bus.connect
        if not all(map(loopback, here)):
            continue
        before, there = first.setdefault(root.ward, (path, here))
        if not {port_of(endpoint) for endpoint in here} & {port_of(endpoint) for endpoint in there}:
            yield (
                f"{path}: [bus] connects to {', '.join(here)}, in {before} to {', '.join(there)}: who goes to one router does"
                " not hear who goes to another: is one of the ports mistaken?"
            )
        own: Any = root.estimator
        if own is not None and (other := stores.setdefault((root.ward, Path(own.store).absolute()), path)) != path:
            yield f"{path}: store is {own.store!r}, as in {other}: each estimator needs one of its own"
        for table in (root.bridge, root.estimator):
            health: str = table.health if table is not None else ""
            for other, ward, address in taken:
                if health and other != path and ward == root.ward and clash(health, address):
                    yield f"{path}: health is {health!r}, and {address!r} in {other}: each program needs a port of its own"
            if health:
                taken.append((path, root.ward, health))


def _twice(wards: Mapping[Path, Root]) -> Iterator[str]:
    """A bridge, an estimator or a device that two files have; the same file read twice is not meant."""
    seen: dict[tuple[str, str, str], Path] = {}
    for path, root in wards.items():
        for what, name in _names(root):
            before = seen.setdefault((root.ward, what, name), path)
            if before != path:
                yield f"{path}: {what} {name!r} of ward {root.ward!r} is in {before} too: give one of them another id"


def _otherwise(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Estimators of one ward share its devices: a device must be treated alike by whoever has it."""
    first: dict[str, tuple[Path, Any]] = {}
    for path, root in wards.items():
        table: Any = root.estimator
        if table is None:
            continue
        before, other = first.setdefault(root.ward, (path, table))
        yield from (
            f"{path}: [estimator] {knob} is {getattr(table, knob)!r}, in {before} {getattr(other, knob)!r}:"
            " estimators of one ward take over each other's devices, and must treat them alike"
            for knob in _ALIKE
            if getattr(table, knob) != getattr(other, knob)
        )
        if (here := _enrolled(root)) != (there := _enrolled(wards[before])):
            names = sorted(name for name in {*here, *there} if name and here.get(name) != there.get(name))
            yield (
                f"{path}: [devices] is not that of {before}, of {', '.join(names[:_NAMED])}: estimators of one ward take"
                " over each other's devices, and whose is not enrolled would not be used"
            )


def _enrolled(root: Root) -> dict[str, str]:
    """The bridge of each enrolled device; of a ward that takes every device that of none is said."""
    return root.devices.read() if root.devices is not None else {"": ""}


def _names(root: Root) -> Iterator[tuple[str, str]]:
    if root.bridge is not None:
        yield "bridge", root.bridge.id
        yield from (("device", device.id) for device in root.bridge.devices)
    if root.estimator is not None:
        yield "estimator", root.estimator.id


def _between(root: Root, routers: Sequence[RouterFile]) -> Iterator[str]:
    ports = {port_of(endpoint) for router in routers for endpoint in router.listen}
    for endpoint in root.bus.connect:
        if port_of(endpoint) not in ports:
            yield f"[bus]: connect: no router listens at {endpoint}; they do at {', '.join(e for r in routers for e in r.listen)}"
    for endpoint in filter(secured, root.bus.connect):
        there = [router for router in routers if port_of(endpoint) in map(port_of, router.listen)]
        hosts = [host for router in there for host in hosts_at(router)]
        if hosts and not any(is_for(host, host_of(endpoint)) for host in hosts):
            yield (
                f"[bus]: connect: {endpoint}: the router's certificate is for {', '.join(hosts)} alone, and we would not talk to"
                " it by another name: truerate pki issue router:NAME --host names all of them"
            )
    member = _member(root)
    if member is None or root.bus.identity is None:
        return
    used = [one for one in routers if any(reaches(endpoint, one) for endpoint in root.bus.connect)] or list(routers)
    yield from (f"[bus]: {words}" for words in _known(root.ward, member, used))
    for router in used:
        if router.identity is None:
            continue
        if member.common_name in router.members and not trusts(router.identity.ca, root.bus.identity.certificate):
            yield (
                f"[bus]: {router.path} has rules for {member.common_name} and does not let in its certificate:"
                " `truerate pki router` writes both files of a router anew"
            )
        if not trusts(root.bus.identity.ca, router.identity.certificate):
            yield (
                f"[bus]: ca: by {root.bus.identity.ca} the certificate of {router.path} is nobody's: we would not talk to that"
                " router; it is the authority's file that belongs there, ca.pem"
            )


def _known(ward: str, member: Member, routers: Sequence[RouterFile]) -> Iterator[str]:
    """Whether each of the routers that a program goes to has rules for it, in its ward."""
    name = member.common_name
    without = [router for router in routers if (ward, name) not in router.places]
    if elsewhere := sorted({place for router in without for place, who in router.places if who == name} - {ward}):
        places = ", ".join(elsewhere)
        yield f"ward is {ward!r}, and routers have rules for {name} in {places} alone: all would be dropped silently"
    elif len(without) == len(routers):
        yield f"no router knows {name}: what it says and asks would be dropped silently"
    else:
        yield from (
            f"{router.path} does not know {name}: what it says and asks would be dropped silently, once it goes there"
            for router in without
        )


def _member(root: Root) -> Member | None:
    try:
        return member_of(root.bus.identity) if root.bus.identity is not None else None
    except ValueError:
        return None  # said already
