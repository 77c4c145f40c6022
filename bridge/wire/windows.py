"""Encoding and decoding of window statistics, with packed columns as in `batches`.

A device's messages are sent about once a second, only while subscribed.
"""

import numpy as np

from bridge.wire import columns_pb2 as columns
from bridge.wire import validation
from bridge.wire.batches import (
    FLOAT,
    MAX_CORRECTED,
    MAX_RATE,
    MAX_SEQUENCE,
    UINT32,
    UINT64,
    Float32s,
    column_of,
    flags_of,
    floats_of,
    packed_flags,
    stds_of,
)
from bridge.wire.envelope import opened
from bridge.wire.messages import VERSION, Quality, WindowBatch
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_TIME_NS, clean

MAX_WINDOWS = 64
#: largest number of samples in a window
MAX_IN_WINDOW = 2**20
_INT64 = np.dtype("<i8")


def encode_windows(batch: WindowBatch) -> bytes:
    """Encode a WindowBatch as bytes, the payload of bus key @windowed/<device>."""
    return columns.WindowBatch(
        version=VERSION,
        device=batch.device,
        boot=batch.boot,
        window_s=batch.window_s,
        sequences=column_of(batch.sequences, UINT64),
        times_ns=column_of(batch.times_ns, _INT64),
        samples=column_of(batch.samples, UINT32),
        flags=packed_flags(batch.flags),
        reading_mean=column_of(batch.reading_mean, FLOAT),
        reading_std=column_of(batch.reading_std, FLOAT),
        reading_min=column_of(batch.reading_min, FLOAT),
        reading_max=column_of(batch.reading_max, FLOAT),
        rate_mean=column_of(batch.rate_mean, FLOAT),
        rate_std=column_of(batch.rate_std, FLOAT),
        rate_min=column_of(batch.rate_min, FLOAT),
        rate_max=column_of(batch.rate_max, FLOAT),
        quality=int(batch.quality),
        noise_std=column_of(batch.noise_std, FLOAT),
        bias_std=column_of(batch.bias_std, FLOAT),
        scale_std=column_of(batch.scale_std, FLOAT),
        cross_std=column_of(batch.cross_std, FLOAT),
        bias=column_of(batch.bias, FLOAT),
        calibration=clean(batch.calibration, validation.MAX_NAME),
        flicker_std=column_of(batch.flicker_std, FLOAT),
    ).SerializeToString()


def decode_windows(key: str, payload: bytes) -> WindowBatch:
    """Decode and validate the payload of bus key @windowed/<device> as a WindowBatch of 1 to MAX_WINDOWS windows.

    Raises Refusal for an invalid message.
    """
    raw, _ = opened(columns.WindowBatch, "@windowed", key, payload)
    sequences = np.frombuffer(_rising(raw.sequences, "sequences", MAX_SEQUENCE), UINT64)
    m = len(sequences)
    times_ns = np.frombuffer(_rising(raw.times_ns, "times_ns", MAX_TIME_NS), _INT64)
    if len(times_ns) != m or len(raw.samples) != 4 * m:
        raise Refusal(
            Reason.LENGTH,
            f"{m} windows, but {len(times_ns)} times and {len(raw.samples)} bytes of samples; {m} and {4 * m} are expected",
        )
    samples = np.frombuffer(raw.samples, UINT32)
    if int(samples.min()) < 1 or int(samples.max()) > MAX_IN_WINDOW:
        raise Refusal(Reason.RANGE, f"a window has no sample, or more than {MAX_IN_WINDOW} samples")
    noise_std, bias_std, scale_std, cross_std, flicker_std = stds_of(raw)
    return WindowBatch(
        device=raw.device,
        boot=raw.boot,
        window_s=validation.number(raw.window_s, "window_s", 1e-3, 60.0),
        sequences=sequences,
        times_ns=times_ns,
        samples=samples,
        flags=flags_of(raw.flags, m),
        reading_mean=_vectors(raw.reading_mean, "reading_mean", m, MAX_RATE),
        reading_std=_deviations(raw.reading_std, "reading_std", m, MAX_RATE),
        reading_min=_vectors(raw.reading_min, "reading_min", m, MAX_RATE),
        reading_max=_vectors(raw.reading_max, "reading_max", m, MAX_RATE),
        rate_mean=_vectors(raw.rate_mean, "rate_mean", m, MAX_CORRECTED),
        rate_std=_deviations(raw.rate_std, "rate_std", m, MAX_CORRECTED),
        rate_min=_vectors(raw.rate_min, "rate_min", m, MAX_CORRECTED),
        rate_max=_vectors(raw.rate_max, "rate_max", m, MAX_CORRECTED),
        quality=validation.member(Quality, raw.quality, "quality"),
        noise_std=noise_std,
        bias_std=bias_std,
        scale_std=scale_std,
        cross_std=cross_std,
        bias=floats_of(raw.bias, "bias", 3, MAX_RATE),
        calibration=validation.text(raw.calibration, "calibration"),
        flicker_std=flicker_std,
    )


def _rising(column: bytes, name: str, high: int) -> bytes:
    """Check a packed column of 1 to MAX_WINDOWS strictly rising 64-bit whole numbers from 0 to high."""
    n, odd = divmod(len(column), 8)
    if odd or not 1 <= n <= MAX_WINDOWS:
        raise Refusal(
            Reason.LENGTH, f"{name} has {len(column)} bytes; 8 per window and 1 to {MAX_WINDOWS} windows are expected"
        )
    validation.rising(np.frombuffer(column, UINT64).tolist(), name, high)
    return column


def _vectors(column: bytes, name: str, m: int, limit: float) -> Float32s:
    return floats_of(column, name, 3 * m, limit).reshape(m, 3)


def _deviations(column: bytes, name: str, m: int, limit: float) -> Float32s:
    found = _vectors(column, name, m, limit)
    if np.minimum.reduce(found, axis=None) < 0:
        raise Refusal(Reason.RANGE, f"{name} has a negative value")
    return found
