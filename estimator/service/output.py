"""Range limits for outgoing messages: brings every number into the range that subscribers' decoders accept."""

from dataclasses import replace
from heapq import nlargest
from math import isnan

import numpy as np
from numpy.typing import NDArray

from bridge.wire import validation
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_RATE, MAX_SEQUENCE, MAX_STD
from bridge.wire.control_messages import MAX_ELEMENT, MAX_POINTS, MIN_POINTS
from bridge.wire.messages import BiasRevision, Status

MAX_SCALE, MAX_HZ, MAX_AGE_S, MAX_COUNT = 10.0, 1e6, 1e12, 2**64 - 1
_OTHERS = "others"


def status(said: Status) -> Status:
    """Return a copy of a status with every number clipped to the range of the wire format.

    NaN becomes 0; NaN of a standard deviation or age becomes the largest value. An unknown temperature stays NaN. If
    there are too many count labels, the rarest are summed as "others".
    """
    return replace(
        said,
        bias=tuple([_within(b, -MAX_RATE, MAX_RATE, 0.0) for b in said.bias]),
        bias_std=tuple([_within(s, 0.0, MAX_STD, MAX_STD) for s in said.bias_std]),
        scale=tuple([_within(s, -MAX_SCALE, MAX_SCALE, 0.0) for s in said.scale]),
        progress=_within(said.progress, 0.0, 1.0, 0.0),
        evidence_age_s=_within(said.evidence_age_s, 0.0, MAX_AGE_S, MAX_AGE_S),
        temperature_c=_within(said.temperature_c, -MAX_CELSIUS, MAX_CELSIUS, np.nan),
        rate_hz=_within(said.rate_hz, 0.0, MAX_HZ, 0.0),
        dropped=_counts(said.dropped),
        events=_counts(said.events),
    )


def linear_accel(found: NDArray[np.float64]) -> bytes:
    """Pack linear acceleration as float32 bytes within the range of the wire format; empty bytes if unknown.

    found (n, 3): acceleration without gravity, m/s². It counts as unknown if its first value is NaN.
    """
    if isnan(found.item(0)):
        return b""
    packed = found.astype(np.float32)
    return (packed if np.vdot(packed, packed) <= MAX_ACCEL**2 else packed.clip(-MAX_ACCEL, MAX_ACCEL)).tobytes()


def revision(said: BiasRevision) -> BiasRevision | None:
    """Return a copy of a bias revision without the points that subscribers would refuse.

    If more than MAX_POINTS points remain, they are thinned evenly to MAX_POINTS.
    None if fewer than MIN_POINTS points remain, or if an element of the calibration matrix is too large for the wire
    format.
    """
    known = ((said.bias_std >= 0) & (said.bias_std < np.inf) & (np.abs(said.bias) <= MAX_RATE)).all(axis=1)
    known &= (said.sequences <= MAX_SEQUENCE) & (said.times_ns >= 0) & (said.times_ns <= validation.MAX_TIME_NS)
    kept = np.flatnonzero(known)
    kept = kept[_rising(said.sequences[kept]) & _rising(said.times_ns[kept])]
    if len(kept) < MIN_POINTS or not (np.abs(said.matrix) <= MAX_ELEMENT).all():
        return None
    if len(kept) > MAX_POINTS:
        kept = kept[np.linspace(0, len(kept) - 1, MAX_POINTS).round().astype(np.intp)]
    return replace(
        said,
        sequences=said.sequences[kept],
        times_ns=said.times_ns[kept],
        bias=said.bias[kept],
        bias_std=np.nan_to_num(np.clip(said.bias_std[kept], 0.0, MAX_STD), nan=MAX_STD).astype(np.float32),
    )


def _rising(numbers: NDArray[np.uint64] | NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the numbers above all numbers before them."""
    return np.append(True, numbers[1:] > np.maximum.accumulate(numbers)[:-1])[: len(numbers)]


def _within(value: float, low: float, high: float, unknown: float) -> float:
    return value if low <= value <= high else unknown if isnan(value) else min(max(value, low), high)


def _counts(counts: dict[str, int]) -> dict[str, int]:
    """Counts with as many labels as the wire takes; the rarest are summed as "others"."""
    if len(counts) > validation.MAX_COUNTS:
        kept = set(nlargest(validation.MAX_COUNTS - 1, (c for c in counts if c != _OTHERS), key=counts.__getitem__))
        others = sum(n for label, n in counts.items() if label not in kept)
        counts = {label: n for label, n in counts.items() if label in kept} | {_OTHERS: others}
    return {label: min(n, MAX_COUNT) for label, n in counts.items()}
