"""Key expressions: validation of bus keys and key patterns, and matching of a pattern against a key.

Fewer keys are accepted here than by zenoh. zenoh also accepts newlines, quotes and keys of up to 65,000 characters, and
a longer key makes the zenoh session unusable.
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
    """Validate a bus key and return it.

    Raises BusError for a key that is empty, has more than MAX_KEY characters, a wildcard or another invalid character.
    """
    return _check(key, _KEY, "a key has 1 to 400 printable ASCII characters in chunks joined by '/', without * $ ? #")


def check_pattern(pattern: str) -> str:
    """Validate a key pattern and return it.

    A chunk is the part of a key between two slashes. `*` stands for one chunk, `**` for any number of chunks.

    Raises BusError for an invalid pattern, and for `**/**` and `**/*`, whose standard forms are `**` and `*/**`.
    """
    _check(pattern, _PATTERN, "a pattern is a key in which a whole chunk may be * or **, without $ ? #")
    if _NOT_CANONICAL.search(pattern):
        raise BusError(f"pattern {pattern!r} is not in its shortest form: write '**' for '**/**' and '*/**' for '**/*'")
    return pattern


def check_patterns(patterns: str | Sequence[str]) -> tuple[str, ...]:
    """Validate one or several key patterns; return them as a tuple without duplicates.

    Raises BusError for an invalid pattern, or if no pattern is given.
    """
    if not patterns:
        raise BusError("no pattern to subscribe to: give at least one")
    return tuple(map(check_pattern, (patterns,) if isinstance(patterns, str) else dict.fromkeys(patterns)))


def _check(text: str, shape: re.Pattern[str], rule: str) -> str:
    if len(text) > MAX_KEY or not shape.match(text):
        raise BusError(f"{text[:64]!r} ({len(text)} characters) was refused: {rule}")
    return text


def matches(pattern: str, key: str) -> bool:
    """Return True if a key pattern matches a key.

    A wildcard never matches a chunk (part of a key between two slashes) that begins with `@`.
    """
    return _shape(pattern).fullmatch(f"/{key}") is not None


@functools.lru_cache(1024)
def _shape(pattern: str) -> re.Pattern[str]:
    chunks = {"*": _ANY, "**": f"(?:{_ANY})*"}
    return re.compile("".join(chunks.get(chunk, f"/{re.escape(chunk)}") for chunk in pattern.split("/")))
