"""Encoding and decoding of sample batches and corrected batches.

Both use the messages of columns.proto, where a repeated number is one packed `bytes` field. The bytes on the wire are
those of truerate.proto, but encoding and decoding are as fast as copying memory.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire import columns_pb2 as columns
from bridge.wire import validation
from bridge.wire.envelope import opened
from bridge.wire.messages import VERSION, CorrectedBatch, Quality, SampleBatch, SampleFlag
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import clean

MAX_SAMPLES = 1024  # the most that fit into MAX_PAYLOAD with every column
MAX_RATE = 1000.0  # rad/s, of a reading or a bias; beyond every gyroscope
MAX_CORRECTED = 2000.0  # rad/s: the largest reading times a scale factor of 2
MAX_ACCEL = 10_000.0  # m/s²
MAX_CELSIUS = 500.0
MAX_STD = 1e6
MAX_SEQUENCE = 2**62
#: fields of a corrected batch that describe its correction, (3,) each
TOLD = ("noise_std", "bias_std", "flicker_std", "scale_std", "cross_std", "bias")
#: packed (3,) zeros, for a message without the column
_NOT_SAID = bytes(12)
_KNOWN_FLAGS = sum(SampleFlag)
FLOAT, UINT64, UINT32 = np.dtype("<f4"), np.dtype("<u8"), np.dtype("<u4")

Float32s = NDArray[np.float32]


def encode_samples(batch: SampleBatch) -> bytes:
    """Encode a SampleBatch as protobuf bytes, the payload of bus key raw/<bridge>/<device>."""
    return columns.SampleBatch(
        version=VERSION,
        device=batch.device,
        boot=batch.boot,
        sequence=batch.sequence,
        receive_time_ns=batch.receive_time_ns,
        start_time_ns=batch.start_time_ns,
        tick_period_s=batch.tick_period_s,
        clock_rate=batch.clock_rate,
        ticks=column_of(batch.ticks, UINT64),
        gyro=column_of(batch.gyro, FLOAT),
        accel=b"" if batch.accel is None else column_of(batch.accel, FLOAT),
        temperature_c=b"" if batch.temperature_c is None else column_of(batch.temperature_c, FLOAT),
        flags=packed_flags(batch.flags),
    ).SerializeToString()


def decode_samples(key: str, payload: bytes) -> SampleBatch:
    """Decode and validate the payload of bus key raw/<bridge>/<device> as a SampleBatch.

    Raises Refusal for an invalid message.
    """
    raw, place = opened(columns.SampleBatch, "raw", key, payload)
    ticks = ticks_of(raw.ticks)
    times_of(raw, ticks)
    n = len(ticks)
    return SampleBatch(
        device=raw.device,
        boot=raw.boot,
        sequence=validation.whole(raw.sequence, "sequence", MAX_SEQUENCE),
        receive_time_ns=validation.time_ns(raw.receive_time_ns, "receive_time_ns"),
        start_time_ns=raw.start_time_ns,
        tick_period_s=raw.tick_period_s,
        clock_rate=raw.clock_rate,
        ticks=ticks,
        gyro=floats_of(raw.gyro, "gyro", 3 * n, MAX_RATE).reshape(n, 3),
        accel=floats_of(raw.accel, "accel", 3 * n, MAX_ACCEL).reshape(n, 3) if raw.accel else None,
        temperature_c=floats_of(raw.temperature_c, "temperature_c", n, MAX_CELSIUS) if raw.temperature_c else None,
        flags=flags_of(raw.flags, n),
        bridge=place.ids["bridge"],
    )


def encode_corrected(batch: CorrectedBatch) -> bytes:
    """Encode a CorrectedBatch as protobuf bytes, the payload of bus key corrected/<device>."""
    encoder = CorrectedEncoder(batch.device, batch.epoch)
    encoder.corrected_by(batch.quality, batch.calibration, np.array([getattr(batch, name) for name in TOLD]))
    clock = batch.start_time_ns, batch.tick_period_s, batch.clock_rate
    ticks, rate = column_of(batch.ticks, UINT64), column_of(batch.rate, FLOAT)
    return encoder.encode(batch.boot, batch.sequence, *clock, ticks, rate, packed_flags(batch.flags))


class CorrectedEncoder:
    """Encoder for the many corrected batches of one device.

    `corrected_by` sets the fields that many batches share: quality, calibration id, bias and standard deviations.
    `encode` adds the fields of one batch.
    epoch: number of the period in which the estimator owns the device, that is, alone processes its samples. A later
    period has a higher number; 0 is unknown.
    """

    def __init__(self, device: str, epoch: int = 0) -> None:
        self._message = columns.CorrectedBatch(version=VERSION, device=device, epoch=epoch)

    def corrected_by(self, quality: Quality, calibration: str, told: Float32s) -> None:
        """Set quality, calibration id, bias and standard deviations of all following messages.

        calibration: id of the calibration in use. told (6, 3): one row for each name in TOLD: noise_std, bias_std,
        flicker_std and bias in rad/s; scale_std and cross_std without unit.
        """
        message = self._message
        message.quality = int(quality)
        message.calibration = clean(calibration, validation.MAX_NAME)
        packed = column_of(told, FLOAT)
        for i, name in enumerate(TOLD):
            setattr(message, name, packed[12 * i : 12 * i + 12])

    def encode(
        self,
        boot: int,
        sequence: int,
        start_time_ns: int,
        tick_period_s: float,
        clock_rate: float,
        ticks: bytes,
        rate: bytes,
        flags: bytes,
    ) -> bytes:
        """Encode one corrected batch as protobuf bytes; the arguments are the fields of CorrectedBatch.

        boot: 64-bit boot number. sequence: number of the first sample since boot. start_time_ns: host time of the first
        sample, ns since the Unix epoch. tick_period_s: duration of one tick of the device clock, s. clock_rate: host
        seconds per device second.
        ticks (n,), rate (n, 3) in rad/s, flags (n,): packed as bytes by `column_of` and `packed_flags`.
        """
        message = self._message
        message.boot = boot
        message.sequence = sequence
        message.start_time_ns = start_time_ns
        message.tick_period_s = tick_period_s
        message.clock_rate = clock_rate
        message.ticks = ticks
        message.rate = rate
        message.flags = flags
        return message.SerializeToString()


def decode_corrected(key: str, payload: bytes) -> CorrectedBatch:
    """Decode and validate the payload of bus key corrected/<device> as a CorrectedBatch.

    Raises Refusal for an invalid message.
    """
    raw, _ = opened(columns.CorrectedBatch, "corrected", key, payload)
    ticks = ticks_of(raw.ticks)
    times_of(raw, ticks)
    n = len(ticks)
    noise_std, bias_std, scale_std, cross_std, flicker_std = stds_of(raw)
    return CorrectedBatch(
        device=raw.device,
        boot=raw.boot,
        sequence=validation.whole(raw.sequence, "sequence", MAX_SEQUENCE),
        start_time_ns=raw.start_time_ns,
        tick_period_s=raw.tick_period_s,
        clock_rate=raw.clock_rate,
        ticks=ticks,
        rate=floats_of(raw.rate, "rate", 3 * n, MAX_CORRECTED).reshape(n, 3),
        flags=flags_of(raw.flags, n),
        quality=validation.member(Quality, raw.quality, "quality"),
        noise_std=noise_std,
        bias_std=bias_std,
        scale_std=scale_std,
        cross_std=cross_std,
        bias=floats_of(raw.bias, "bias", 3, MAX_RATE),
        calibration=validation.text(raw.calibration, "calibration"),
        epoch=validation.whole(raw.epoch, "epoch", validation.MAX_EPOCH),
        flicker_std=flicker_std,
    )


class Rates(NamedTuple):
    """Corrected rates of one message: device id, and rate (n, 3) float32 in rad/s, sensor frame."""

    device: str
    rate: Float32s


def decode_rates(key: str, payload: bytes) -> Rates:
    """Decode only the rates of a corrected batch, in a quarter of decode_corrected's time; skip other fields.

    Raises Refusal for an invalid payload, key, id or rate.
    """
    raw, _ = opened(columns.CorrectedBatch, "corrected", key, payload)
    n = len(raw.rate) // 12
    if not 1 <= n <= MAX_SAMPLES:
        raise Refusal(Reason.LENGTH, f"rate has {n} samples: use 1 to {MAX_SAMPLES}")
    return Rates(raw.device, floats_of(raw.rate, "rate", 3 * n, MAX_CORRECTED).reshape(n, 3))


def column_of(column: NDArray[np.generic], dtype: np.dtype[Any]) -> bytes:
    """Pack an array of any shape as bytes, row by row, each element little-endian in the given data type."""
    return column.astype(dtype, copy=False).tobytes()


def packed_flags(flags: NDArray[np.uint32]) -> bytes:
    """Pack sample flags (n,) as bytes, 4 bytes per sample; empty if all flags are 0."""
    packed = column_of(flags, UINT32)
    return packed if packed.strip(b"\0") else b""


def ticks_of(column: bytes) -> NDArray[np.uint64]:
    """Unpack device ticks (8 bytes each) as a read-only (n,) uint64 array.

    Raises Refusal unless there are 1 to MAX_SAMPLES ticks, strictly rising and below 2**63.
    """
    n, odd = divmod(len(column), 8)
    if odd or not 1 <= n <= MAX_SAMPLES:
        raise Refusal(
            Reason.LENGTH, f"ticks has {len(column)} bytes; 8 per sample and 1 to {MAX_SAMPLES} samples are expected"
        )
    ticks = np.frombuffer(column, UINT64)
    if not np.logical_and.reduce(ticks[1:] > ticks[:-1]) or int(ticks[-1]) >= 2**63:
        raise Refusal(Reason.RANGE, "ticks do not increase from sample to sample, or reach 2**63")
    return ticks


def times_of(
    raw: columns.SampleBatch | columns.CorrectedBatch | columns.OrientationBatch, ticks: NDArray[np.uint64]
) -> None:
    """Check the fields start_time_ns, tick_period_s and clock_rate of a batch, and the host time of its last sample.

    raw: the received message. ticks (n,): ticks of its samples. Raises Refusal if a value is out of range.
    """
    start_ns = validation.time_ns(raw.start_time_ns, "start_time_ns")
    period_s = validation.number(raw.tick_period_s, "tick_period_s", 1e-9, 1.0)
    rate = validation.number(raw.clock_rate, "clock_rate", 1e-4, 1e4)
    if start_ns + float(ticks[-1] - ticks[0]) * (period_s * rate * 1e9) > validation.MAX_TIME_NS:
        raise Refusal(Reason.RANGE, f"the time of the last sample is above {validation.MAX_TIME_NS} ns")


def floats_of(column: bytes, name: str, n: int, limit: float) -> Float32s:
    """Unpack float32 numbers (4 bytes each) as a read-only (n,) array, in the unit of the field.

    limit: largest absolute value. name: the field, for the error text.
    Raises Refusal for another length, and for NaN, infinity or a value beyond the limit.
    """
    if len(column) != 4 * n:
        raise Refusal(Reason.LENGTH, f"{name} has {len(column)} bytes; {4 * n} are expected")
    values = np.frombuffer(column, FLOAT)
    if np.vdot(values, values) <= limit * limit:  # usual case, at half the cost: the norm bounds every value
        return values
    # Without the sign bit, floats sort like their bits, with infinity and NaN last: one comparison covers all.
    worst = int(np.maximum.reduce(values.view(UINT32) & 0x7FFFFFFF))
    if worst > np.float32(limit).view(np.uint32):
        if worst >= 0x7F800000:
            raise Refusal(Reason.NON_FINITE, f"{name} has a value that is not a number")
        raise Refusal(Reason.RANGE, f"{name} has a value beyond {limit:g}")
    return values


def stds_of(raw: columns.CorrectedBatch | columns.WindowBatch) -> NDArray[np.float32]:
    """Unpack the standard deviations of a message as a read-only (5, 3) float32 array.

    Rows: noise, bias (rad/s), scale, cross-axis (without unit), flicker (rad/s; 0 if absent).
    Raises Refusal for another number of values, and for a value that is negative, not finite or too large.
    """
    said = {name: getattr(raw, name) for name in ("noise_std", "bias_std", "scale_std", "cross_std")}
    said["flicker_std"] = raw.flicker_std or _NOT_SAID
    for name, column in said.items():
        if len(column) != 12:
            raise Refusal(Reason.LENGTH, f"{name} has {len(column)} bytes; 12 are expected")
    stds = floats_of(b"".join(said.values()), "a standard deviation", 3 * len(said), MAX_STD)
    if np.minimum.reduce(stds) < 0:
        raise Refusal(Reason.RANGE, "a standard deviation is negative")
    return stds.reshape(-1, 3)


def flags_of(column: bytes, n: int) -> NDArray[np.uint32]:
    """Unpack n sample flags (4 bytes each) as a (n,) uint32 array; an empty column means that all are 0.

    Raises Refusal for another length and for unknown bits.
    """
    if not column:
        return np.zeros(n, np.uint32)
    if len(column) != 4 * n:
        raise Refusal(Reason.LENGTH, f"flags has {len(column)} bytes; {4 * n} are expected")
    flags = np.frombuffer(column, UINT32)
    if (flags & ~np.uint32(_KNOWN_FLAGS)).any():
        raise Refusal(Reason.RANGE, "flags has a bit that version 1 does not know")
    return flags
