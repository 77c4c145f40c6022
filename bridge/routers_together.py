"""Checks whether routers' files go together, and which of them an endpoint leads to."""

from collections.abc import Iterator, Sequence

from bridge.bus.router_check import RouterFile
from bridge.config import ANYWHERE
from bridge.pki.identity import ISSUER_OF, Identity, certificates, common_name, hosts_of, member_of, verified

_ANEW = "`truerate pki router` writes both files of a router, copy both"


def faults(routers: Sequence[RouterFile]) -> Iterator[str]:
    """Routers whose two files differ, or that do not find or know each other; each a sentence that begins with the file."""
    for router in routers:
        yield from (f"{router.path}: {words}" for words in (*_lets_in(router), *_joins(router, routers)))
    for ward in sorted({ward for router in routers for ward, _ in router.places}):
        of_ward = [router for router in routers if any(ward == place for place, _ in router.places)]
        for router in of_ward:
            if len(of_ward) > 1 and not any(_leads(router, one) or _leads(one, router) for one in routers):
                yield (
                    f"{router.path}: nothing joins it to the other routers of ward {ward!r}: who goes to one would not hear"
                    " who goes to another; `truerate pki router --join` names the other's endpoint"
                )


def reaches(endpoint: str, router: RouterFile) -> bool:
    """Whether an endpoint leads to a router: by its port, and the names of its certificate or the address it listens at."""
    hosts = hosts_at(router) or [host_of(listen) for listen in router.listen]
    return port_of(endpoint) in map(port_of, router.listen) and any(
        host in ANYWHERE or is_for(host, host_of(endpoint)) for host in hosts
    )


def hosts_at(router: RouterFile) -> list[str]:
    """Names and addresses in a router's certificate; none where that is not at hand."""
    try:
        return hosts_of(certificates(router.identity.certificate)[0]) if router.identity else []
    except ValueError:
        return []


def trusts(asking: Identity, shown: Identity) -> bool:
    """Whether one takes the certificate of another; of a file that cannot be read something is said elsewhere."""
    try:
        return verified(shown.certificate, asking.ca)
    except ValueError:
        return True


def host_of(endpoint: str) -> str:
    """The name or address in an endpoint."""
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return address.rpartition(":")[0].strip("[]").lower()


def is_for(certified: str, host: str) -> bool:
    """Whether a name in a certificate is that of a host; a `*` stands for one part."""
    name = certified.lower()
    return name == host or (name.startswith("*.") and name[2:] == host.partition(".")[2])


def port_of(endpoint: str) -> tuple[str, str]:
    """Protocol and port; of a Unix socket its path."""
    protocol, _, address = endpoint.partition("/")
    bare = address.partition("#")[0].partition("?")[0]
    return protocol, bare if protocol.startswith("unixsock") else bare.rpartition(":")[2]


def _lets_in(router: RouterFile) -> Iterator[str]:
    """Whether a router's certificates of issuers are those of the members that it has rules for."""
    try:
        trusted = [common_name(one) for one in certificates(router.identity.ca)] if router.identity else []
    except ValueError:
        return  # said elsewhere
    there = {name.removeprefix(ISSUER_OF) for name in trusted if name.startswith(ISSUER_OF)}
    if not there or router.identity is None:
        return  # a site's own authority
    known = router.members | {_name(router)}
    if more := sorted(there - known):
        yield f"{router.identity.ca} lets in {', '.join(more)}, revoked maybe, whom the rules do not know: {_ANEW}"
    if missing := sorted(known - there - {""}):
        yield f"{router.identity.ca} does not let in {', '.join(missing)}, whom the rules know: {_ANEW}"


def _joins(router: RouterFile, routers: Sequence[RouterFile]) -> Iterator[str]:
    for endpoint in router.join:
        for other in (other for other in routers if other is not router and reaches(endpoint, other)):
            for one, two in ((router, other), (other, router)):
                if (name := _name(two)) and name not in one.members:
                    yield (
                        f"connect: {endpoint}: {one.path} has no rules for {name}, and drops all that comes from it:"
                        " `truerate pki router` writes it anew"
                    )


def _leads(router: RouterFile, other: RouterFile) -> bool:
    return other is not router and any(reaches(endpoint, other) for endpoint in router.join)


def _name(router: RouterFile) -> str:
    try:
        return member_of(router.identity).common_name if router.identity else ""
    except ValueError:
        return ""
