"""Plausibility checks of readings: equal lengths, finite values, rates and accelerations within what a sensor can measure."""

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Readings
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE, MAX_SAMPLES
from bridge.wire.refusal import Reason

PLAUSIBLE = 2.0  # multiple of full scale; common sensitivity mistakes reach 1.17
_MAX_COUNT = 2**62
_SURELY = 0.99  # of the squared limit; the rest allows for rounding
_FEW = 4096  # values; for many more, BLAS would wake its threads
_FOUR = 4  # bytes; counters this narrow cannot be too large

Bools = NDArray[np.bool_]


def fault(readings: Readings) -> Reason | None:
    """Return the reason to refuse readings as a whole; None if they are acceptable.

    LENGTH: columns of different lengths, or no sample. RANGE: a sequence number or tick count is too large.
    """
    n, accel, temperature_c = len(readings.ticks), readings.accel, readings.temperature_c
    whole = (
        n > 0
        and readings.gyro.shape == (n, 3)
        and (accel is None or accel.shape == (n, 3))
        and (temperature_c is None or temperature_c.shape == (n,))
    )
    if not whole:
        return Reason.LENGTH
    large = readings.ticks.itemsize > _FOUR and int(readings.ticks.max()) >= _MAX_COUNT
    if large or not 0 <= readings.sequence < _MAX_COUNT:
        return Reason.RANGE
    return None


def sound(readings: Readings, gyro_range: float) -> tuple[Bools, Bools] | None:
    """Return two masks (n,): samples with finite values, and samples with plausible values; None if all are plausible.

    gyro_range: full-scale range in rad/s, 0 if unknown. Plausible on every axis: rates up to twice the full-scale range
    and at most MAX_RATE (rad/s), accelerations up to MAX_ACCEL (m/s²). A sample with NaN or infinity is in neither
    mask.
    """
    limit = _limit(gyro_range)
    # Almost always all pass; NaN fails the comparison.
    if within(readings.gyro, limit) and (readings.accel is None or within(readings.accel, MAX_ACCEL)):
        return None
    finite = np.isfinite(readings.gyro).all(axis=1)
    with np.errstate(invalid="ignore"):
        plausible = (np.abs(readings.gyro) <= limit).all(axis=1)
        if readings.accel is not None:
            finite &= np.isfinite(readings.accel).all(axis=1)
            plausible &= (np.abs(readings.accel) <= MAX_ACCEL).all(axis=1)
    return finite, finite & plausible


def temperature(readings: Readings, run: slice) -> NDArray[np.float32] | None:
    """Return the temperatures (n,) float32 °C of the samples `run`; None if there are none, or if one value is unusable.

    run: slice of sample indices in the readings. Unusable: not a number, or beyond MAX_CELSIUS (°C) in magnitude.
    """
    if readings.temperature_c is None:
        return None
    column = readings.temperature_c[run]
    return np.ascontiguousarray(column, np.float32) if within(column, MAX_CELSIUS) else None


def _limit(gyro_range: float) -> float:
    return min(MAX_RATE, PLAUSIBLE * gyro_range) if gyro_range else MAX_RATE


def within(column: NDArray[np.floating], limit: float) -> bool:
    """Return True if all magnitudes in a column (n,) or (n, 3) are at most `limit`, in the column's unit. False for NaN."""
    # A sum of squares below the squared limit proves it: the usual case, at a third of the cost.
    if column.size <= _FEW and np.vdot(column, column) <= _SURELY * limit * limit:
        return True
    return bool(np.maximum.reduce(np.abs(column), axis=None) <= limit)


def runs(n: int, good: Bools | None) -> list[slice]:
    """Return the unbroken runs of good samples, as slices into n samples, each at most MAX_SAMPLES long.

    good (n,): True for good samples; None if all are good.
    """
    edges = [0, n]
    if good is not None:
        edges = np.flatnonzero(np.diff(good.astype(np.int8), prepend=0, append=0)).tolist()
    return [
        slice(begin, min(begin + MAX_SAMPLES, end))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        for begin in range(start, end, MAX_SAMPLES)
    ]
