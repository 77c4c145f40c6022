"""Cross-checks of a ward's files: conflicts between ids, endpoints, certificates, settings and router access rules."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from bridge.bus.router_check import RouterFile, open_to_others
from bridge.bus.routers import Routers, secured
from bridge.config.router_cross_checks import faults as router_faults
from bridge.config.router_cross_checks import host_of, hosts_at, is_for, port_of, reaches
from bridge.config.schema import ConfigError, Root
from bridge.pki.certificate_checks import Identity, member_of
from bridge.pki.certificate_checks import faults as identity_faults
from bridge.pki.member import Member, Role

#: settings that must be equal in all estimators of a ward, because they take over each other's devices
_ALIKE = ("method", "model", "models", "horizontal_turns", "warming_s", "silence_s")


def faults(wards: Mapping[Path, Root], routers: Sequence[RouterFile], now: datetime) -> list[str]:
    """Compare ward files with each other, with their certificates and with the routers' access rules; return all faults.

    Each fault is a sentence that begins with the path of the file.
    wards: content of the ward files, by path. routers: content of the routers' configuration files.
    now: time at which certificates must be valid, a datetime with time zone.
    """
    return [
        *(f"{router.path}: {words}" for router in routers for words in _of_router(router, now)),
        *(f"{path}: {words}" for path, root in wards.items() for words in _of_ward(root, now)),
        *_twice(wards),
        *_otherwise(wards),
        *(f"{path}: {words}" for path, root in wards.items() if routers for words in _between(root, routers)),
    ]


def soon(wards: Mapping[Path, Root], routers: Sequence[RouterFile]) -> Iterator[str]:
    """Yield a sentence for each certificate of these ward files and routers that expires soon.

    A certificate expires soon in the last 14 days of its validity, or in the last third if this is shorter.
    Each sentence begins with the path of the file. wards: content of the ward files, by path. routers: content of the
    routers' configuration files.
    """
    for path, root in wards.items():
        yield from (f"{path}: [bus]: {words}" for routers in root.bus.every() for words in routers.soon())
    for router in routers:
        yield from (f"{router.path}: {words}" for words in Routers(router.listen, router.identity).soon())


def unused(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Yield a sentence for each device id in `[estimator] models` that is not an enrolled device.

    Enrolled devices are those of the table [devices]. Without this table, they are the devices of the bridges in the
    ward files.
    wards: content of the ward files, by path.
    """
    for path, root in wards.items():
        listed = {
            one.id
            for other in wards.values()
            if other.ward == root.ward and other.bridge
            for one in other.bridge.devices
        }
        there = set(root.devices.places) if root.devices is not None else listed
        models: Mapping[str, str] = root.estimator.models if root.estimator is not None and there else {}
        for device in sorted(models.keys() - there):
            close = get_close_matches(device, there, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ": correct the id"
            yield f"{path}: [estimator]: models: {device!r} is neither enrolled nor a device of these files{hint}"


def _of_router(router: RouterFile, now: datetime) -> Iterator[str]:
    yield from (*router.faults, *router_faults(router))
    if router.identity is not None:
        yield from identity_faults(router.identity, now, (Role.ROUTER,))


def _of_ward(root: Root, now: datetime) -> Iterator[str]:
    yield from (f"[router]: listen: {words}" for words in open_to_others(root.router.listen))
    tables = {Role.BRIDGE: root.bridge, Role.ESTIMATOR: root.estimator}
    roles = set(tables) if root.bus.pki else set[Role]()
    for identity in _identities(root):
        wrong = identity_faults(identity, now, tuple(role for role in Role if not role.serves))
        yield from (f"[bus]: {words}" for words in wrong)
        if (member := _member(identity)) is not None:
            roles.add(member.role)
            if member.role in tables and tables[member.role] is None and not root.bus.pki:
                table = f"[{member.role.value}]"
                yield (
                    f"[bus]: the certificate is for {member.label}, but this file has no table {table}: add the table, or "
                    "give another certificate"
                )
    # With one certificate, the file may have further tables beside that of the certificate's role.
    for role, table in tables.items():
        if table is not None and role in roles:
            try:
                root.bus.routers_as(role, name=table.id)
            except ConfigError as error:
                yield str(error)


def _twice(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Yield a fault for each bridge, estimator or device id that occurs in two files."""
    seen: dict[tuple[str, str, str], Path] = {}
    for path, root in wards.items():
        for what, name in _names(root):
            before = seen.setdefault((root.ward, what, name), path)
            if before != path:
                yield f"{path}: {what} {name!r} of ward {root.ward!r} is in {before} too: rename one of the two"


def _names(root: Root) -> Iterator[tuple[str, str]]:
    if root.bridge is not None:
        yield "bridge", root.bridge.id
        yield from (("device", device.id) for device in root.bridge.devices)
    if root.estimator is not None:
        yield "estimator", root.estimator.id


def _otherwise(wards: Mapping[Path, Root]) -> Iterator[str]:
    """Yield a fault for each setting that differs between estimators of one ward."""
    first: dict[str, tuple[Path, dict[str, Any]]] = {}
    for path, root in wards.items():
        if (table := root.estimator) is None:
            continue
        here = {f"[estimator] {knob}": getattr(table, knob) for knob in _ALIKE}
        here["[devices]"] = root.devices.places if root.devices is not None else None
        before, there = first.setdefault(root.ward, (path, here))
        yield from (
            f"{path}: {what} differs from {before}: make them equal, because estimators of one ward take over each other's"
            " devices"
            for what, value in here.items()
            if value != there[what]
        )


def _between(root: Root, routers: Sequence[RouterFile]) -> Iterator[str]:
    ports = {port_of(endpoint) for router in routers for endpoint in router.listen}
    for endpoint in root.bus.connect:
        hosts = [host for one in routers if port_of(endpoint) in map(port_of, one.listen) for host in hosts_at(one)]
        if port_of(endpoint) not in ports:
            yield f"[bus]: connect: no router listens at {endpoint}; use {', '.join(e for r in routers for e in r.listen)}"
        elif secured(endpoint) and hosts and not any(is_for(host, host_of(endpoint)) for host in hosts):
            yield (
                f"[bus]: connect: {endpoint}: the router's certificate names only {', '.join(hosts)}: connect by one of"
                " these, or issue a certificate with this host: truerate pki issue router:NAME --host HOST"
            )
    near = [one for one in routers if any(reaches(endpoint, one) for endpoint in root.bus.connect)] or routers
    for member in filter(None, map(_member, _identities(root))):
        for router in near:
            if (root.ward, member.common_name) not in router.places:
                wards = ", ".join(sorted(ward for ward, name in router.places if name == member.common_name))
                instead = f" (only rules for {member.common_name} in ward {wards})" if wards else ""
                yield (
                    f"[bus]: {router.path} has no rules for {member.common_name} in ward {root.ward!r}{instead}: the router would"
                    " drop its messages silently. Write the router's file again (truerate pki router)"
                )


def _identities(root: Root) -> Iterator[Identity]:
    return (routers.identity for routers in root.bus.every() if routers.identity is not None)


def _member(identity: Identity) -> Member | None:
    try:
        return member_of(identity)
    except ValueError:
        return None  # already reported
