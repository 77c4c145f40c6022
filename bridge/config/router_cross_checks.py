"""Cross-checks of a router: trusted issuers against access rules, and which router a given endpoint leads to."""

from collections.abc import Iterator

from bridge.bus.router_check import RouterFile
from bridge.config.schema import ANYWHERE
from bridge.pki.certificate_checks import ISSUER_OF, certificates, common_name, hosts_of, member_of

_ANEW = "write both files of the router with `truerate pki router`, and copy both"


def faults(router: RouterFile) -> Iterator[str]:
    """Compare the members whose certificates a router accepts with the members in its access rules.

    Yields one sentence about members that are accepted but have no rules, and one about members that have rules but are
    not accepted. A member is accepted if the router trusts the issuer of the member's certificates.
    Yields nothing if the router has no readable certificates, or if it trusts a site's own authority instead of one
    issuer per member.
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
        yield f"{router.identity.ca} accepts {', '.join(more)}, but has no access rules for them (perhaps revoked): {_ANEW}"
    if missing := sorted(known - there):
        yield f"{router.identity.ca} refuses {', '.join(missing)}, although access rules name them: {_ANEW}"


def reaches(endpoint: str, router: RouterFile) -> bool:
    """Return True if an endpoint such as `tls/ward-3.example:7447` leads to this router.

    The protocol and the port must be the same. The host must be in the router's certificate; without certificate, among
    the hosts that the router listens on.
    """
    hosts = hosts_at(router) or [host_of(listen) for listen in router.listen]
    return port_of(endpoint) in map(port_of, router.listen) and any(
        host in ANYWHERE or is_for(host, host_of(endpoint)) for host in hosts
    )


def hosts_at(router: RouterFile) -> list[str]:
    """Return the host names and IP addresses in a router's certificate; [] if there is no readable certificate."""
    try:
        return hosts_of(certificates(router.identity.certificate)[0]) if router.identity else []
    except ValueError:
        return []


def host_of(endpoint: str) -> str:
    """Return the host name or address of an endpoint, in lower case: `10.0.0.5` for `tls/10.0.0.5:7447`."""
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return address.rpartition(":")[0].strip("[]").lower()


def is_for(certified: str, host: str) -> bool:
    """Return True if a certificate's name matches a host. A leading `*.` stands for one label, as in `*.ward.example`."""
    name = certified.lower()
    return name == host or (name.startswith("*.") and name[2:] == host.partition(".")[2])


def port_of(endpoint: str) -> tuple[str, str]:
    """Return (protocol, port) of an endpoint as texts, such as ("tls", "7447").

    For a Unix socket, the path takes the place of the port.
    """
    protocol, _, address = endpoint.partition("/")
    bare = address.partition("#")[0].partition("?")[0]
    return protocol, bare if protocol.startswith("unixsock") else bare.rpartition(":")[2]
