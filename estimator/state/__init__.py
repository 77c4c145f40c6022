"""Serialisation of state to bytes: typed msgspec structs, arrays as shape and values, compressed.

Decoding checks types and size.
"""

import threading
import zlib
from functools import lru_cache
from math import prod
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
T = TypeVar("T")

#: msgspec describes a type at its first use, and crashes when two threads do so at once
_ONE_AT_A_TIME = threading.Lock()
#: most bytes of an inflated state, and most values in one array
_MOST_BYTES, _MOST_VALUES = 1 << 22, 1 << 18


class StateStruct(msgspec.Struct, array_like=True):
    """Base class of state that can be saved: a msgspec struct, which `encode` writes as the list of its fields."""


def encode(state: StateStruct) -> bytes:
    """Encode a state as MessagePack bytes, compressed with zlib; equal states give equal bytes.

    Arrays must be float64. `decode` is the inverse.
    """
    return zlib.compress(msgspec.msgpack.encode(state, enc_hook=_packed, order="deterministic"), 1)


def decode(data: bytes, kind: type[T]) -> T:
    """Decode bytes made by `encode` into a state of type `kind`; arrays become float64.

    The shapes of arrays are not checked; use `shaped`. Raises ValueError if the bytes are damaged, do not fit `kind`,
    or inflate to more than 4 MiB.
    """
    inflating = zlib.decompressobj()
    try:
        # Damaged values may be signalling NaNs.
        with _ONE_AT_A_TIME, np.errstate(invalid="ignore"):
            return msgspec.msgpack.decode(inflating.decompress(data, _MOST_BYTES), type=kind, dec_hook=_unpacked)
    except (zlib.error, msgspec.MsgspecError) as error:
        words = str(error).replace("damaged state: ", "").replace("; start without this state", "")
        raise ValueError(f"damaged state: {words}; start without this state") from error


def shaped(array: Floats, *shape: int, finite: bool = False) -> None:
    """Check that a decoded array has the expected shape; -1 in `shape` allows any length.

    finite: also check that every value is finite. Raises ValueError if a check fails.
    """
    if array.ndim != len(shape) or any(want not in (-1, n) for want, n in zip(shape, array.shape, strict=True)):
        raise ValueError(
            f"damaged state: an array has shape {array.shape}, but {shape} is expected; start without this state"
        )
    if finite and not np.isfinite(array).all():
        raise ValueError("damaged state: an array has a value that is not finite; start without this state")


def _packed(array: Floats) -> tuple[str, tuple[int, ...], bytes]:
    """Pack an array: float32 where exact, only the upper triangle of a symmetric matrix."""
    values = array.tobytes()
    with np.errstate(over="ignore"):
        short = array.astype(np.float32)
    if short.astype(np.float64).tobytes() == values:
        return "f", array.shape, short.tobytes()
    if array.ndim == 2 and array.shape[0] == array.shape[1] and array.T.tobytes() == values:
        return "s", array.shape, array[_upper(len(array))].tobytes()
    return "d", array.shape, values


@lru_cache(maxsize=32)
def _upper(n: int) -> tuple[NDArray[np.intp], ...]:
    return np.triu_indices(n)


def _unpacked(_: type, packed: Any) -> Floats:
    kind, shape, data = msgspec.convert(packed, tuple[str, tuple[int, ...], bytes])
    if len(shape) > 3 or any(n < 0 for n in shape) or prod(shape) > _MOST_VALUES:
        raise ValueError(
            f"an array of {len(shape)} dimensions has no valid shape: at most 3 dimensions and {_MOST_VALUES} values are allowed"
        )
    if kind == "s":
        if len(shape) != 2 or shape[0] != shape[1]:
            raise ValueError(f"a symmetric matrix has shape {shape}, which is not square")
        array, upper = np.empty(shape), _upper(shape[0])
        array[upper] = array.T[upper] = np.frombuffer(data, np.float64)
        return array
    return np.frombuffer(data, np.float32 if kind == "f" else np.float64).reshape(shape).astype(np.float64)
