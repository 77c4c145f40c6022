"""Prepare a session's output for the wire: every number within the range that subscribers' decoders accept."""

from dataclasses import replace
from heapq import nlargest
from itertools import pairwise
from math import isnan

import numpy as np
from numpy.typing import NDArray

from bridge.wire import validation
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_CORRECTED, MAX_RATE, MAX_SEQUENCE, MAX_STD, CorrectedEncoder
from bridge.wire.messages import BiasRevision, Status, WindowBatch
from bridge.wire.orientation import encode_columns
from bridge.wire.revisions import MAX_ELEMENT, MAX_POINTS, MIN_POINTS
from estimator.device.batch_correction import Cut, Rates
from estimator.device.correction import Correction
from estimator.device.orientation import OrientedCut

MAX_SCALE, MAX_HZ, MAX_AGE_S, MAX_COUNT = 10.0, 1e6, 1e12, 2**64 - 1
_OTHERS = "others"


def status(said: Status) -> Status:
    """Status with every number in the wire's range; NaN becomes the worst value of the range."""
    if _status_fits(said):
        return said
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


def _status_fits(said: Status) -> bool:
    """Whether every number of the status is in the wire's range already."""
    numbers = (
        0.0 <= said.progress <= 1.0
        and 0.0 <= said.evidence_age_s <= MAX_AGE_S
        and (isnan(said.temperature_c) or abs(said.temperature_c) <= MAX_CELSIUS)
        and 0.0 <= said.rate_hz <= MAX_HZ
    )
    vectors = (said.bias, -MAX_RATE, MAX_RATE), (said.bias_std, 0.0, MAX_STD), (said.scale, -MAX_SCALE, MAX_SCALE)
    return (
        numbers
        and all(low <= value <= high for values, low, high in vectors for value in values)
        and all(len(counts) <= validation.MAX_COUNTS for counts in (said.dropped, said.events))
        and all(n <= MAX_COUNT for counts in (said.dropped, said.events) for n in counts.values())
    )


class Encoder:
    """Encoder of one device's corrected samples into payloads within the wire's limits."""

    def __init__(self, device: str, epoch: int = 0) -> None:
        self._encoder = CorrectedEncoder(device, epoch)
        self._correction: Correction | None = None  # correction of the last encoded batch

    def encode(self, cut: Cut, rates: Rates) -> bytes:
        """Encode a cut of samples with its corrected rates."""
        samples, correction = cut.samples, cut.correction
        if correction is not self._correction:
            self._correction = correction
            self._encoder.corrected_by(correction.quality, correction.calibration, _told(correction))
        return self._encoder.encode(
            samples.boot,
            cut.sequence,
            cut.start_time_ns,
            samples.tick_period_s,
            samples.clock_rate,
            cut.ticks,
            *rates,
        )


class Orientations:
    """Encoder of one device's orientation into payloads within the wire's limits."""

    def __init__(self, device: str, epoch: int = 0) -> None:
        self._of = device, epoch

    def encode(self, one: OrientedCut) -> bytes:
        """Encode the orientation of a cut of samples; an acceleration beyond the range is limited to it."""
        cut, attitudes, zero = one
        samples, accel = cut.samples, b""
        if not isnan(attitudes.accel.item(0)):
            force = attitudes.accel.astype(np.float32)
            accel = (force if np.vdot(force, force) <= MAX_ACCEL**2 else force.clip(-MAX_ACCEL, MAX_ACCEL)).tobytes()
        return encode_columns(
            *self._of,
            samples.boot,
            cut.sequence,
            (cut.start_time_ns, samples.tick_period_s, samples.clock_rate),
            cut.ticks,
            attitudes.quat_wxyz.astype(np.float32).tobytes(),
            accel,
            attitudes.cov[-1].astype(np.float32).tobytes(),
            zero,
            cut.correction.quality,
        )


def _told(correction: Correction) -> dict[str, NDArray[np.float32]]:
    """Published values of a correction, each number in the wire's range."""
    told = correction.told._asdict()
    if all(abs(value) <= min(MAX_RATE, MAX_STD) for column in told.values() for value in column.tolist()):
        return told
    return {
        name: _clipped(value, -MAX_RATE, MAX_RATE) if name == "bias" else _clipped(value, 0.0, MAX_STD)
        for name, value in told.items()
    }


def revision(said: BiasRevision) -> BiasRevision | None:
    """Revision without points that subscribers would refuse, evenly thinned to MAX_POINTS; None with too few points."""
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
        bias_std=_clipped(said.bias_std[kept], 0.0, MAX_STD),
    )


def windows(said: WindowBatch) -> WindowBatch | None:
    """Windows, for viewers; None where a time or number is outside the wire's range."""
    times = said.times_ns.tolist()
    if times[0] < 0 or times[-1] > validation.MAX_TIME_NS or any(a >= b for a, b in pairwise(times)):
        return None
    most = max(float(said.rate_max.max()), -float(said.rate_min.min()))
    worst = max(*said.noise_std.tolist(), *said.bias_std.tolist(), *said.scale_std.tolist())
    fits = most <= MAX_CORRECTED and worst <= MAX_STD and max(map(abs, said.bias.tolist())) <= MAX_RATE
    return said if fits else None


def _rising(numbers: NDArray[np.uint64] | NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the numbers above all numbers before them."""
    return np.append(True, numbers[1:] > np.maximum.accumulate(numbers)[:-1])[: len(numbers)]


def _within(value: float, low: float, high: float, unknown: float) -> float:
    return value if low <= value <= high else unknown if isnan(value) else min(max(value, low), high)


def _clipped(
    values: np.ndarray[tuple[int, ...], np.dtype[np.float32]], low: float, high: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.nan_to_num(np.clip(values, low, high), nan=high).astype(np.float32)


def _counts(counts: dict[str, int]) -> dict[str, int]:
    """Counts with as many labels as the wire takes; the rarest are summed as "others"."""
    if len(counts) > validation.MAX_COUNTS:
        kept = set(nlargest(validation.MAX_COUNTS - 1, (c for c in counts if c != _OTHERS), key=counts.__getitem__))
        others = sum(n for label, n in counts.items() if label not in kept)
        counts = {label: n for label, n in counts.items() if label in kept} | {_OTHERS: others}
    return {label: min(n, MAX_COUNT) for label, n in counts.items()}
