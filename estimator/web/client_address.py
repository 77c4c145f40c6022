"""Grouping of client addresses into networks of one customer, for rate limits. Pure."""

from functools import lru_cache
from ipaddress import IPv6Address, IPv6Network, ip_address

#: prefix length that a provider gives to one customer, IPv6
_CUSTOMER = 64


@lru_cache(4096)
def neighbourhood(address: str) -> str:
    """Return the key under which rate limits count a client address: for an IPv6 address, its /64 network.

    One machine may hold all addresses of a /64 network. An IPv4-mapped IPv6 address becomes IPv4. Other addresses are
    returned unchanged.
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
