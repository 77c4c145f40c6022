"""State as bytes: typed structs by msgspec, arrays as shape and float64 values, all of it deflated; checked when it is read."""

import zlib
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
T = TypeVar("T")

#: bytes that a state may have when it is inflated, and values in one array
_MOST_BYTES, _MOST_VALUES = 1 << 22, 1 << 18


class StateStruct(msgspec.Struct, array_like=True):
    """What evolves of something."""


def encode(state: StateStruct) -> bytes:
    """The bytes of a state: the same of the same state, so sets are put in order."""
    return zlib.compress(msgspec.msgpack.encode(state, enc_hook=_packed, order="deterministic"), 1)


def decode(data: bytes, kind: type[T]) -> T:
    """The state of a kind from its bytes. Raises ValueError: not such a state; its arrays are of any shape."""
    inflating = zlib.decompressobj()
    try:
        return msgspec.msgpack.decode(inflating.decompress(data, _MOST_BYTES), type=kind, dec_hook=_unpacked)
    except (zlib.error, msgspec.MsgspecError) as error:
        raise ValueError(f"damaged state: {error}") from error


def shaped(array: Floats, *shape: int, finite: bool = False) -> None:
    """Raises ValueError where an array has another shape (-1: any length), or where it is to be finite and is not."""
    if array.ndim != len(shape) or any(want not in (-1, n) for want, n in zip(shape, array.shape, strict=True)):
        raise ValueError(f"damaged state: an array is {array.shape}, expected {shape}")
    if finite and not np.isfinite(array).all():
        raise ValueError("damaged state: an array is not finite")


def _packed(array: Floats) -> tuple[str, tuple[int, ...], bytes]:
    """Shape and values: float32 where that is exact, one triangle of a symmetric matrix."""
    values = array.tobytes()
    with np.errstate(over="ignore"):
        short = array.astype(np.float32)
    if short.astype(np.float64).tobytes() == values:
        return "f", array.shape, short.tobytes()
    if array.ndim == 2 and array.shape[0] == array.shape[1] and array.T.tobytes() == values:
        return "s", array.shape, array[np.triu_indices(len(array))].tobytes()
    return "d", array.shape, values


def _unpacked(_: type, packed: Any) -> Floats:
    kind, shape, data = msgspec.convert(packed, tuple[str, tuple[int, ...], bytes])
    if any(n < 0 for n in shape) or np.prod([*shape], dtype=float) > _MOST_VALUES:
        raise ValueError(f"an array of shape {shape}")
    if kind == "s":
        if len(shape) != 2 or shape[0] != shape[1]:
            raise ValueError(f"a symmetric matrix of shape {shape}")
        array, upper = np.empty(shape), np.triu_indices(shape[0])
        array[upper] = array.T[upper] = np.frombuffer(data, np.float64)
        return array
    return np.frombuffer(data, np.float32 if kind == "f" else np.float64).reshape(shape).astype(np.float64)
