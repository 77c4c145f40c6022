"""Whether routers' files go together, and which of them an endpoint leads to."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from bridge.bus.router_check import RouterFile
from bridge.bus.routers import secured
from bridge.config import ANYWHERE
from bridge.pki.chain import ISSUER_OF
from bridge.pki.identity import Identity, certificates, common_name, hosts_of, member_of, verified


def faults(routers: Sequence[RouterFile]) -> Iterator[str]:
    """What two of them have and only one may, who joins nobody, and who would not be let in."""
    yield from _twice(routers)
    for router in routers:
        yield from (f"{router.path}: {words}" for words in (*_lets_in(router), *_joins(router, routers)))
    for ward in sorted({ward for router in routers for ward, _ in router.places}):
        yield from _apart(ward, routers)


def reaches(endpoint: str, router: RouterFile) -> bool:
    """Whether an endpoint leads to a router: by its port, and the names of its certificate or the address it listens at."""
    there = [listen for listen in router.listen if port_of(listen) == port_of(endpoint)]
    if not there:
        return False
    if secured(endpoint) and (hosts := hosts_at(router)):
        return any(is_for(host, host_of(endpoint)) for host in hosts)
    return any(host_of(listen) in (*ANYWHERE, host_of(endpoint)) for listen in there)


def hosts_at(router: RouterFile) -> list[str]:
    """What a router's certificate is for; nothing where it is not at hand."""
    try:
        return hosts_of(certificates(router.identity.certificate)[0]) if router.identity else []
    except ValueError:
        return []


def trusts(ca: str, certificate: str) -> bool:
    """Whether who goes by `ca` takes a certificate; a file that is not there, or is none, is said of elsewhere."""
    try:
        return verified(certificate, ca)
    except ValueError:
        return True


def host_of(endpoint: str) -> str:
    """The name or address in an endpoint."""
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return address.rpartition(":")[0].strip("[]").lower()


def is_for(certified: str, host: str) -> bool:
    """Whether a name of a certificate is that of a host; a `*` stands for one part."""
    name = certified.lower()
    return name == host or (name.startswith("*.") and name[2:] == host.partition(".")[2])


def port_of(endpoint: str) -> tuple[str, str]:
    """Protocol and port: by which name or address a machine is reached is not in its own file."""
    protocol, _, address = endpoint.partition("/")
    bare = address.partition("#")[0].partition("?")[0]
    return protocol, bare if protocol.startswith("unixsock") else bare.rpartition(":")[2]


def _lets_in(router: RouterFile) -> Iterator[str]:
    """Whether a router that goes by its members' issuers goes by those of whom it has rules for, and by nobody else."""
    try:
        trusted = [common_name(one) for one in certificates(router.identity.ca)] if router.identity else []
    except ValueError:
        return  # said elsewhere
    there = {name.removeprefix(ISSUER_OF) for name in trusted if name.startswith(ISSUER_OF)}
    known, others = (
        (router.members | {_name(router)}) - {""},
        [name for name in trusted if not name.startswith(ISSUER_OF)],
    )
    if not there or not router.identity:
        return
    file, anew = (
        f"root_ca_certificate: {router.identity.ca}",
        "`truerate pki router` writes both files of a router, copy both",
    )
    if more := sorted(there - known):
        yield f"{file} lets in {', '.join(more)}, revoked maybe, whom the rules do not know: {anew}"
    missing = sorted(known - there)
    if missing and not others:
        yield f"{file} does not let in {', '.join(missing)}, whom the rules know: {anew}"
    if others and not missing:
        yield f"{file} lets in whomever {', '.join(map(repr, others))} has signed, also who was revoked: {anew}"


def _twice(routers: Sequence[RouterFile]) -> Iterator[str]:
    seen: dict[str, Path] = {}
    for router in routers:
        own = {f"id {router.id!r}"} if router.id else set[str]()
        own |= {name} if (name := _name(router)) else set()
        own |= {listen for listen in router.listen if host_of(listen) not in ANYWHERE}
        for what in sorted(own):
            before = seen.setdefault(what, router.path)
            if before != router.path:
                yield f"{router.path}: {what} is that of {before} too: each router has its own, else they do not find each other"


def _joins(router: RouterFile, routers: Sequence[RouterFile]) -> Iterator[str]:
    for endpoint in router.join:
        if _is_itself(endpoint, router):
            yield f"connect: {endpoint} is this router itself; another's belongs there"
            continue
        for other in (other for other in routers if other is not router and reaches(endpoint, other)):
            for one, two in ((router, other), (other, router)):
                if one.members and (name := _name(two)) and name not in one.members:
                    yield (
                        f"connect: {endpoint}: {one.path} has no rules for {name}, and drops all that comes from it:"
                        " `truerate pki router` writes it anew"
                    )
            if _shut(router.joins_as, other.identity) or _shut(other.identity, router.joins_as):
                yield (
                    f"connect: {endpoint}: one of the two does not let in the other's certificate: `truerate pki router`"
                    " writes both files of a router anew"
                )


def _is_itself(endpoint: str, router: RouterFile) -> bool:
    """Whether an endpoint is a router's own; of one that listens everywhere only a certificate tells its hosts."""
    told = not secured(endpoint) or hosts_at(router) or host_of(endpoint) in map(host_of, router.listen)
    return bool(told) and reaches(endpoint, router)


def _apart(ward: str, routers: Sequence[RouterFile]) -> Iterator[str]:
    """Routers of a ward that none of the files joins to the first of them."""
    first, *others = [router for router in routers if any(ward == place for place, _ in router.places)]
    joined, new = {first.path}, [first]
    while new:
        at = new.pop()
        near = [one for one in routers if one.path not in joined and (_leads(at, one) or _leads(one, at))]
        joined |= {one.path for one in near}
        new += near
    for router in others:
        if router.path not in joined:
            yield (
                f"{router.path}: nothing joins it to {first.path}, of ward {ward!r} too: who goes to one would not hear who goes"
                " to the other; `truerate pki router --join` names the other's endpoint"
            )


def _leads(router: RouterFile, other: RouterFile) -> bool:
    return any(reaches(endpoint, other) for endpoint in router.join)


def _shut(shown: Identity | None, asking: Identity | None) -> bool:
    return shown is not None and asking is not None and not trusts(asking.ca, shown.certificate)


def _name(router: RouterFile) -> str:
    try:
        return member_of(router.identity).common_name if router.identity else ""
    except ValueError:
        return ""
