"""Key expressions: validation of keys and patterns, and whether a pattern matches a key.

Narrower than zenoh's key expressions on purpose. zenoh accepts newlines, quotes and 65,000 characters; a still longer key
breaks its session for good.
"""

import functools
import re
from collections.abc import Sequence

from bridge.bus.contract import BusError

MAX_KEY = 400
_CHUNK = r"[^\s/*$?#\x00-\x1f\x7f-\U0010ffff]+"
_KEY = re.compile(rf"{_CHUNK}(?:/{_CHUNK})*\Z")
_PATTERN = re.compile(rf"(?:\*\*?|{_CHUNK})(?:/(?:\*\*?|{_CHUNK}))*\Z")
#: a chunk that a wildcard matches, with the slash before it
_ANY = "/[^/@][^/]*"
_NOT_CANONICAL = re.compile(r"(?:^|/)\*\*/\*")


def check_key(key: str) -> str:
    """Return the bus key if it is valid and without wildcards, else raise BusError."""
    return _check(key, _KEY, "a key has 1 to 400 printable ASCII characters in chunks joined by '/', without * $ ? #")


def check_pattern(pattern: str) -> str:
    """Return the key pattern if it is valid, else raise BusError.

    A whole chunk may be `*` (one chunk) or `**` (any number).
    """
    _check(pattern, _PATTERN, "a pattern is a key in which a whole chunk may be * or **, without $ ? #")
    if _NOT_CANONICAL.search(pattern):
        raise BusError(f"pattern {pattern!r} is not in its shortest form: write '**' for '**/**' and '*/**' for '**/*'")
    return pattern


def check_patterns(patterns: str | Sequence[str]) -> tuple[str, ...]:
    """Return one or several key patterns as a tuple without duplicates.

    Raises BusError for an invalid one, or for none.
    """
    if not patterns:
        raise BusError("no pattern to subscribe to: give at least one")
    return tuple(map(check_pattern, (patterns,) if isinstance(patterns, str) else dict.fromkeys(patterns)))


def _check(text: str, shape: re.Pattern[str], rule: str) -> str:
    if len(text) > MAX_KEY or not shape.match(text):
        raise BusError(f"{text[:64]!r} ({len(text)} characters) was refused: {rule}")
    return text


def matches(pattern: str, key: str) -> bool:
    """Return whether the key pattern matches the key. No wildcard matches a chunk that begins with `@`."""
    return _shape(pattern).fullmatch(f"/{key}") is not None


@functools.lru_cache(1024)
def _shape(pattern: str) -> re.Pattern[str]:
    chunks = {"*": _ANY, "**": f"(?:{_ANY})*"}
    return re.compile("".join(chunks.get(chunk, f"/{re.escape(chunk)}") for chunk in pattern.split("/")))
