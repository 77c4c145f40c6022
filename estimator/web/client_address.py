"""Group client addresses by customer, for rate limits. Pure."""

from functools import lru_cache
from ipaddress import IPv6Address, IPv6Network, ip_address

#: prefix length that a provider gives to one customer, IPv6
_CUSTOMER = 64


@lru_cache(4096)
def neighbourhood(address: str) -> str:
    """Return the address under which a client is counted: an IPv6 address's /64, since one machine may hold all of it.

    IPv4 addresses and anything else stay as they are; an IPv4-mapped IPv6 address becomes IPv4.
    """
    try:
        ip = ip_address(address)
    except ValueError:
        return address
    if not isinstance(ip, IPv6Address):
        return address
    if ip.ipv4_mapped is not None:
        return str(ip.ipv4_mapped)
    return str(IPv6Network((int(ip), _CUSTOMER), strict=False))
