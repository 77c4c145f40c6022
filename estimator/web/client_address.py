"""Whom an address stands for, where they are counted. Pure."""

from functools import lru_cache
from ipaddress import IPv6Address, IPv6Network, ip_address

#: of an IPv6 address, what a provider gives to one customer
_CUSTOMER = 64


@lru_cache(4096)
def neighbourhood(address: str) -> str:
    """An IPv4 address as it is, of an IPv6 address its /64, of which one machine has all; anything else as it is."""
    try:
        ip = ip_address(address)
    except ValueError:
        return address
    if not isinstance(ip, IPv6Address):
        return address
    if ip.ipv4_mapped is not None:
        return str(ip.ipv4_mapped)
    return str(IPv6Network((int(ip), _CUSTOMER), strict=False))
