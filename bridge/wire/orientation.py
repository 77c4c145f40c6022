"""Encoding and decoding of orientation batches, with packed columns as in `batches`."""

import numpy as np

from bridge.wire import columns_pb2 as columns
from bridge.wire import validation
from bridge.wire.batches import FLOAT, MAX_ACCEL, MAX_SEQUENCE, UINT64, column_of, floats_of, ticks_of, times_of
from bridge.wire.envelope import opened
from bridge.wire.messages import VERSION, OrientationBatch, Quality
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import clean

#: rad², a variance of an angle: no attitude is less sure than one of which nothing is known
MAX_COVARIANCE = 10.0
#: largest difference of a quaternion's length from 1
_LENGTH = 1e-3
_ROWS, _COLUMNS = np.triu_indices(3)


def encode_orientation(batch: OrientationBatch) -> bytes:
    """Encode an OrientationBatch as bytes, the payload of bus key orientation/<device>."""
    clock = batch.start_time_ns, batch.tick_period_s, batch.clock_rate
    return encode_columns(
        batch.device,
        batch.epoch,
        (batch.boot, batch.sequence, *clock, column_of(batch.ticks, UINT64)),
        column_of(batch.quat_wxyz, FLOAT),
        b"" if batch.linear_accel is None else column_of(batch.linear_accel, FLOAT),
        column_of(batch.covariance[_ROWS, _COLUMNS], FLOAT),
        (batch.zero_sequence, batch.zero),
        batch.quality,
    )


def encode_columns(
    device: str,
    epoch: int,
    header: tuple[int, int, int, float, float, bytes],
    quat_wxyz: bytes,
    linear_accel: bytes,
    covariance: bytes,
    zero: tuple[int, str],
    quality: Quality,
) -> bytes:
    """Encode an orientation batch as protobuf bytes, from columns packed by `column_of`.

    epoch: number of the period in which the estimator owns the device; a later period has a higher number.
    header: the fields boot, sequence, start_time_ns, tick_period_s, clock_rate and ticks of OrientationBatch; the ticks
    are packed.
    quat_wxyz (n, 4): packed float32, unit quaternions from sensor to earth. linear_accel (n, 3): packed float32, m/s²,
    earth axes; empty without an accelerometer. covariance (6,): packed float32, xx, xy, xz, yy, yz, zz of the attitude
    error, rad², earth axes.
    zero: number of the sample at which the heading was zero, and who reset the heading (`start` for nobody).
    quality: that of the corrected rates of the same samples.
    """
    boot, sequence, start_time_ns, tick_period_s, clock_rate, ticks = header
    return columns.OrientationBatch(
        version=VERSION,
        device=device,
        epoch=epoch,
        boot=boot,
        sequence=sequence,
        start_time_ns=start_time_ns,
        tick_period_s=tick_period_s,
        clock_rate=clock_rate,
        ticks=ticks,
        quat_wxyz=quat_wxyz,
        linear_accel=linear_accel,
        covariance=covariance,
        zero_sequence=zero[0],
        zero=clean(zero[1], validation.MAX_NAME),
        quality=int(quality),
    ).SerializeToString()


def decode_orientation(key: str, payload: bytes) -> OrientationBatch:
    """Decode and validate the payload of bus key orientation/<device> as an OrientationBatch.

    Raises Refusal for an invalid message.
    """
    raw, _ = opened(columns.OrientationBatch, "orientation", key, payload)
    ticks = ticks_of(raw.ticks)
    times_of(raw, ticks)
    n = len(ticks)
    quaternions = floats_of(raw.quat_wxyz, "quat_wxyz", 4 * n, 1 + _LENGTH).reshape(n, 4)
    if np.abs(np.einsum("ij,ij->i", quaternions, quaternions) - 1).max() > 2 * _LENGTH:
        raise Refusal(Reason.RANGE, "quat_wxyz has a quaternion whose length is not 1")
    upper, covariance = floats_of(raw.covariance, "covariance", 6, MAX_COVARIANCE), np.empty((3, 3), np.float32)
    covariance[_ROWS, _COLUMNS] = covariance[_COLUMNS, _ROWS] = upper
    if covariance.diagonal().min() < 0:
        raise Refusal(Reason.RANGE, "covariance has a negative variance")
    force = raw.linear_accel
    return OrientationBatch(
        device=raw.device,
        boot=raw.boot,
        sequence=validation.whole(raw.sequence, "sequence", MAX_SEQUENCE),
        start_time_ns=raw.start_time_ns,
        tick_period_s=raw.tick_period_s,
        clock_rate=raw.clock_rate,
        ticks=ticks,
        quat_wxyz=quaternions,
        linear_accel=floats_of(force, "linear_accel", 3 * n, MAX_ACCEL).reshape(n, 3) if force else None,
        covariance=covariance,
        zero_sequence=validation.whole(raw.zero_sequence, "zero_sequence", MAX_SEQUENCE),
        zero=validation.text(raw.zero, "zero"),
        quality=validation.member(Quality, raw.quality, "quality"),
        epoch=validation.whole(raw.epoch, "epoch", validation.MAX_EPOCH),
    )
