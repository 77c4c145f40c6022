"""Builder and parser of bus keys: `truerate/@v1/<ward>/<what>/...`. No other module builds or parses keys.

Every id is checked when a key is built and when it is parsed. The bus itself accepts wildcards, newlines and quotes in
keys.
"""

import functools
import re
from dataclasses import dataclass

from bridge.wire.refusal import Reason, Refusal

ROOT = "truerate/@v1"
ID = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}\Z")
VERBS = ("recalibrate", "cancel", "note", "zero-heading", "forget", "erase", "place", "acknowledge")
# kind of message -> names of the ids that follow in its key
SHAPES: dict[str, tuple[str, ...]] = {
    "raw": ("bridge", "device"),
    "info": ("bridge", "device"),
    "corrected": ("device",),
    "orientation": ("device",),
    "status": ("device",),
    "calibration": ("device",),
    "revision": ("device",),
    "note": ("device",),
    "@windowed": ("device",),
    "checkpoint": ("device",),
    "owned": ("estimator",),
    "alive/device": ("device", "boot"),
    "alive/bridge": ("bridge",),
    "alive/estimator": ("estimator",),
    "alive/probe": ("role", "name"),
    "rpc": ("device", "verb"),
    "config": ("role", "name"),
}
MAX_KEY = 200
# Keys for display, in every ward: the router may shed these, but not the keys that programs depend on.
VIEWED = tuple(f"{ROOT}/*/{what}/*" for what in ("corrected", "status", "@windowed"))
# No wildcard matches a kind that begins with @: such messages are neither recorded nor made unless requested by name.
BY_NAME = tuple(what for what in SHAPES if what.startswith("@"))


@dataclass(frozen=True, slots=True)
class Key:
    """Parsed bus key. ward: id of the ward. what: kind of message, as in SHAPES. ids: ids by their names in SHAPES."""

    ward: str
    what: str
    ids: dict[str, str]

    @property
    def device(self) -> str:
        """Device id in the key. Raises KeyError for a kind of key without a device, such as `owned`."""
        return self.ids["device"]


def check_id(text: object, what: str = "id") -> str:
    """Return `text` if it is a valid id. what: kind of id, for the error message.

    Raises Refusal(BAD_ID), which states the valid format, for any other text.
    """
    if not isinstance(text, str) or not ID.match(text):
        raise Refusal(
            Reason.BAD_ID,
            f"{what} {str(text)[:64]!r} is not valid: use 1 to 32 of a-z, 0-9, '-' and '_', beginning with a letter or digit",
        )
    return text


def build(ward: str, what: str, **ids: str) -> str:
    """Build the bus key of one kind of message in a ward.

    what: kind of message, as in SHAPES. ids: such as device="chest". Raises KeyError for an unknown kind, TypeError if
    ids are missing or extra, and Refusal(BAD_ID) for an invalid id.
    """
    shape = SHAPES[what]
    if set(ids) != set(shape):
        raise TypeError(f"{what} takes {shape}, got {tuple(ids)}")
    return "/".join([ROOT, check_id(ward, "ward"), what, *(check_id(ids[name], name) for name in shape)])


def pattern(ward: str, what: str, **ids: str) -> str:
    """Build the key pattern for subscribing to one kind of message in a ward, with `*` for every id not given.

    what: kind of message, as in SHAPES. ids: such as device="chest". Raises KeyError for an unknown kind, TypeError
    for an extra id, and Refusal(BAD_ID) for an invalid id.
    """
    shape = SHAPES[what]
    if not set(ids) <= set(shape):
        raise TypeError(f"{what} takes {shape}, got {tuple(ids)}")
    return "/".join([ROOT, check_id(ward, "ward"), what, *(check_id(ids[n], n) if n in ids else "*" for n in shape)])


def everything(ward: str) -> str:
    """Build the key pattern for subscribing to all messages of a ward, except kinds whose name begins with `@`.

    The excepted kinds, such as `@windowed`, are listed in BY_NAME; each needs a subscription of its own.
    Raises Refusal(BAD_ID) for an invalid ward.
    """
    return "/".join([ROOT, check_id(ward, "ward"), "**"])


def boot_id(boot: int) -> str:
    """Format a 64-bit boot number as a key's boot id: 16 hexadecimal digits."""
    return f"{boot:016x}"


@functools.lru_cache(maxsize=8192)  # a ward uses the same few keys again and again
def parse(key: str) -> Key:
    """Parse a received bus key. The result is cached: do not modify it.

    Raises Refusal for a wildcard, an unknown kind, an invalid id, and a key that is too long.
    """
    if len(key) > MAX_KEY:
        raise Refusal(Reason.BAD_KEY, f"the key has {len(key)} characters; at most {MAX_KEY} are allowed")
    if "*" in key or "$" in key:
        raise Refusal(Reason.WILDCARD_KEY, f"a sample must name one device, not {key!r}")
    if not key.startswith(ROOT + "/"):
        raise Refusal(Reason.BAD_KEY, f"{key!r} does not begin with {ROOT}/")
    ward, *rest = key[len(ROOT) + 1 :].split("/")
    what = "/".join(rest[:2]) if rest[:1] == ["alive"] else "".join(rest[:1])
    shape = SHAPES.get(what)
    ids = rest[what.count("/") + 1 :]
    if shape is None or len(ids) != len(shape):
        raise Refusal(Reason.BAD_KEY, f"{key!r} is not a key of {', '.join(SHAPES)} with its ids")
    check_id(ward, "ward")
    for name, value in zip(shape, ids, strict=True):
        check_id(value, name)
    return Key(ward, what, dict(zip(shape, ids, strict=True)))
