"""Field checks of the decoder: each function returns the typed value or raises Refusal.

The argument `name` is the field, for the error text.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bridge.wire.refusal import Reason, Refusal

E = TypeVar("E", bound=IntEnum)

MAX_NAME = 64
MAX_PORT = 256
MAX_SENTENCE = 500
MAX_COUNTS = 64
MAX_TEXTS = 16
MAX_TIME_NS = 2**62
MAX_EPOCH = 2**62


def clean(text: str, limit: int) -> str:
    """Make a text of this program valid for the wire: printable, and at most `limit` characters.

    Unprintable characters become blanks.
    """
    if len(text) <= limit and text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " for c in text[:limit])


def text(value: str, name: str, limit: int = MAX_NAME) -> str:
    """Check a received text and return it. Raises Refusal unless it has at most `limit` characters, all printable."""
    if len(value) > limit:
        raise Refusal(Reason.LENGTH, f"{name} has {len(value)} characters; at most {limit} are allowed")
    if not value.isprintable():
        raise Refusal(Reason.MALFORMED, f"{name} {value[:MAX_NAME]!r} has characters that cannot be printed")
    return value


def number(value: float, name: str, low: float, high: float) -> float:
    """Check a received number and return it. Raises Refusal unless it is finite and from low to high, both included."""
    if not math.isfinite(value):
        raise Refusal(Reason.NON_FINITE, f"{name} is {value}")
    if not low <= value <= high:
        raise Refusal(Reason.RANGE, f"{name} is {value:g}: use {low:g} to {high:g}")
    return value


def number_or_nan(value: float, name: str, low: float, high: float) -> float:
    """Check a received number and return it; NaN is accepted and means unknown.

    Raises Refusal if the number is infinite, or not from low to high, both included.
    """
    return value if math.isnan(value) else number(value, name, low, high)


def whole(value: int, name: str, high: int) -> int:
    """Check a received whole number and return it. Raises Refusal unless it is from 0 to high, both included."""
    if not 0 <= value <= high:
        raise Refusal(Reason.RANGE, f"{name} is {value}: use 0 to {high}")
    return value


def time_ns(value: int, name: str) -> int:
    """Check a received time, ns since the Unix epoch, and return it; 0 means no time.

    Raises Refusal unless it is from 0 to MAX_TIME_NS.
    """
    return whole(value, name, MAX_TIME_NS)


def member(kind: type[E], value: int, name: str) -> E:
    """Convert a received number to the member of an enumeration. Raises Refusal if no member has this value.

    kind: the enumeration.
    """
    try:
        return kind(value)
    except ValueError:
        raise Refusal(Reason.RANGE, f"{name} is {value}, which is not a {kind.__name__}") from None


def vector(values: Iterable[float], name: str, n: int, low: float, high: float) -> NDArray[np.float64]:
    """Convert received numbers, finite and from low to high, to a float64 array (n,), in the unit of the field.

    Raises Refusal for another number of values, and for a value that is not finite or out of range.
    """
    array = np.array(values, dtype=np.float64)
    if len(array) == n and all(low <= value <= high for value in array.tolist()):
        return array
    if array.shape != (n,):
        raise Refusal(Reason.LENGTH, f"{name} has {array.size} values; {n} are expected")
    if not np.isfinite(array).all():
        raise Refusal(Reason.NON_FINITE, f"{name} has {array[~np.isfinite(array)][0]}")
    beyond = array[(array < low) | (array > high)]
    if len(beyond):
        raise Refusal(Reason.RANGE, f"{name} has {beyond[0]:g}: use {low:g} to {high:g}")
    return array


def rising(values: Sequence[int], name: str, high: int) -> Sequence[int]:
    """Check received whole numbers and return them. Raises Refusal unless they rise strictly, from 0 to high."""
    for before, value in pairwise((-1, *values)):
        if not before < value <= high:
            raise Refusal(
                Reason.RANGE, f"{name} has {value} after {before}; rising numbers from 0 to {high} are expected"
            )
    return values


def counts(values: Mapping[str, int], name: str) -> dict[str, int]:
    """Check received counts by label, such as dropped samples by reason, and return them.

    Raises Refusal for more than MAX_COUNTS labels, and for a label that is not a short printable text.
    """
    if len(values) > MAX_COUNTS:
        raise Refusal(Reason.LENGTH, f"{name} has {len(values)} labels; at most {MAX_COUNTS} are allowed")
    return {text(label, f"a label of {name}"): n for label, n in values.items()}
