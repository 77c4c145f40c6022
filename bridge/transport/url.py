"""Parser of the part of an address behind its scheme: `host:port`, `?name=value`; errors give an example."""

import math
from collections.abc import Sequence
from urllib.parse import parse_qsl

from bridge.toml.loader import nearest


def host_port(text: str, example: str, *, host_needed: bool = True) -> tuple[str, int]:
    """Parse `10.0.0.5:8000`, `wrist-1.local:8000` or `[fe80::1]:8000` into host and port (1 to 65535).

    host_needed: False if the host may be empty. Raises ValueError, whose text ends in `example`, for an invalid host or
    port.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or not 1 <= int(port) <= 65_535:
        raise ValueError(f"{text!r} has no port from 1 to 65535: write for example {example!r}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise ValueError(f"{text!r}: put an IPv6 address in brackets: [{host}]:{port}")
    if (not host and host_needed) or not _is_host(host):
        raise ValueError(f"{text!r} has no host: write for example {example!r}")
    return host, int(port)


def host(text: str, example: str) -> str:
    """Parse a host without port, with or without brackets; returns the host without brackets.

    Raises ValueError, whose text ends in `example`, for an invalid host.
    """
    bare = text.removeprefix("[").removesuffix("]")
    if not bare or not _is_host(bare):
        raise ValueError(f"{text!r} is not a host: write for example {example!r}")
    return bare


def options(text: str, known: Sequence[str], example: str) -> tuple[str, dict[str, str]]:
    """Split off the `name=value` options behind `?`; returns the text before `?`, and the values by name.

    known: the valid names. example: a valid address, for the error text. Raises ValueError for an unknown name, and for
    a name given twice.
    """
    before, mark, query = text.partition("?")
    if not mark:
        return before, {}
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True)
    except ValueError:
        raise ValueError(f"{text!r}: write name=value after '?', for example {example!r}") from None
    for name, _ in pairs:
        if name not in known:
            raise ValueError(f"{text!r}: unknown option {name!r}; {nearest(name, known)}")
    if len(dict(pairs)) < len(pairs):
        raise ValueError(f"{text!r}: an option is given twice: give each option once, as in {example!r}")
    return before, dict(pairs)


def number(text: str, name: str, low: float, high: float) -> float:
    """Parse the number of an option, from low to high. Raises ValueError for any other text.

    name: name of the option, for the error text.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ValueError(f"{name} is {text!r}: use {low:g} to {high:g}")
    return value


def _is_host(text: str) -> bool:
    return text.isprintable() and not set(text) & set(" /@#?[]")
