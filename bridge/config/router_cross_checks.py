"""Cross-checks of a router: trusted issuers against access rules, and which router an endpoint leads to."""

from collections.abc import Iterator

from bridge.bus.router_check import RouterFile
from bridge.config.schema import ANYWHERE
from bridge.pki.certificate_checks import ISSUER_OF, certificates, common_name, hosts_of, member_of

_ANEW = "write both files of the router with `truerate pki router`, and copy both"


def faults(router: RouterFile) -> Iterator[str]:
    """Yield faults of members trusted by a router without access rules, and of members with rules but not trusted.

    Each is a sentence for a person.
    The issuers in the router's file of authorities are compared with the names in its access rules. Nothing is compared
    if a certificate is unreadable, or if the site has its own authority.
    """
    try:
        trusted = [common_name(one) for one in certificates(router.identity.ca)] if router.identity else []
        own = {member_of(router.identity).common_name} if router.identity else set()
    except ValueError:
        return  # reported elsewhere
    there = {name.removeprefix(ISSUER_OF) for name in trusted if name.startswith(ISSUER_OF)}
    if not there or router.identity is None:
        return  # the site has its own authority: no issuer per member
    known = router.members | own
    if more := sorted(there - known):
        yield f"{router.identity.ca} accepts {', '.join(more)}, which the rules lack (perhaps revoked): {_ANEW}"
    if missing := sorted(known - there):
        yield f"{router.identity.ca} refuses {', '.join(missing)}, which the rules name: {_ANEW}"


def reaches(endpoint: str, router: RouterFile) -> bool:
    """Return whether an endpoint such as `tls/ward-3.example:7447` leads to this router.

    The protocol and port must be the same; the host must be in the router's certificate, else in its listen addresses.
    """
    hosts = hosts_at(router) or [host_of(listen) for listen in router.listen]
    return port_of(endpoint) in map(port_of, router.listen) and any(
        host in ANYWHERE or is_for(host, host_of(endpoint)) for host in hosts
    )


def hosts_at(router: RouterFile) -> list[str]:
    """Return the host names and addresses in a router's certificate; empty if the certificate is unavailable."""
    try:
        return hosts_of(certificates(router.identity.certificate)[0]) if router.identity else []
    except ValueError:
        return []


def host_of(endpoint: str) -> str:
    """Return the host name or address of an endpoint, in lower case: `10.0.0.5` of `tls/10.0.0.5:7447`."""
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return address.rpartition(":")[0].strip("[]").lower()


def is_for(certified: str, host: str) -> bool:
    """Return whether a name in a certificate matches a host. A leading `*.` stands for one part: `*.ward.example`."""
    name = certified.lower()
    return name == host or (name.startswith("*.") and name[2:] == host.partition(".")[2])


def port_of(endpoint: str) -> tuple[str, str]:
    """Return protocol and port of an endpoint as texts, such as ("tls", "7447").

    A Unix socket has its path instead of a port.
    """
    protocol, _, address = endpoint.partition("/")
    bare = address.partition("#")[0].partition("?")[0]
    return protocol, bare if protocol.startswith("unixsock") else bare.rpartition(":")[2]
