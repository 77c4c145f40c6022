"""Bulk decoder: converts the sample messages of one round of the run loop into columns in one step."""

from array import array
from collections.abc import Sequence
from itertools import accumulate, chain, pairwise

import numpy as np
from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire import columns_pb2 as messages_pb2
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.messages import VERSION, SampleFlag
from bridge.wire.refusal import Refusal
from bridge.wire.validation import MAX_TIME_NS
from estimator.kernels.samples import unpacked
from estimator.samples.sample_buffer import UNFIT, WIDTH, Samples

#: limits of gyro, accel, °C and host time; all flags, flags that make a reading unfit, and the temperature step flag
_LIMITS = np.array(
    [MAX_RATE, MAX_ACCEL, MAX_CELSIUS, MAX_TIME_NS, sum(SampleFlag), UNFIT, SampleFlag.TEMPERATURE_STEP], float
)


#: fields read from a message: bridge, device; boot, sequence; receive and start time, tick period, clock rate; columns
_Read = tuple[str, str, int, int, int, int, float, float, bytes, bytes, bytes, bytes, bytes]


def decode(messages: Sequence[Message]) -> list[Samples | Refusal]:
    """Decode sample messages in bulk; returns for each message, in order, its samples or the reason for refusal.

    The result equals that of `codec.decode_samples`, which decodes one message. Nothing is raised.
    """
    read = [_read(*message) for message in messages]
    plain = iter(_columns([one for one in read if one is not None]))
    found = [None if one is None else next(plain) for one in read]
    return [_alone(*message) if one is None else one for message, one in zip(messages, found, strict=True)]


def _read(key: str, payload: bytes) -> _Read | None:
    """Parse a message and check its column lengths, but not the values; None where anything is unusual."""
    try:
        place, raw = keys.parse(key), messages_pb2.SampleBatch.FromString(payload)
    except (Refusal, DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None
    ticks, gyro, accel, celsius, flags = raw.ticks, raw.gyro, raw.accel, raw.temperature_c, raw.flags
    sequence, received_ns, start_ns = raw.sequence, raw.receive_time_ns, raw.start_time_ns
    period_s, rate, n, device = raw.tick_period_s, raw.clock_rate, len(ticks) // 8, raw.device
    fit = (
        place.what == "raw"
        and raw.version == VERSION
        and device == place.ids["device"]
        and len(payload) <= MAX_PAYLOAD
        and 1 <= n <= MAX_SAMPLES
        and len(ticks) == 8 * n
        and len(gyro) == 12 * n
        and len(accel) in (0, 12 * n)
        and len(celsius) in (0, 4 * n)
        and len(flags) in (0, 4 * n)
        and sequence <= MAX_SEQUENCE
        and 0 <= received_ns <= MAX_TIME_NS
        and 0 <= start_ns <= MAX_TIME_NS
        and 1e-9 <= period_s <= 1.0
        and 1e-4 <= rate <= 1e4
    )
    if not fit:
        return None
    packed = ticks, gyro, accel, celsius, flags
    return place.ids["bridge"], device, raw.boot, sequence, received_ns, start_ns, period_s, rate, *packed


def _columns(read: Sequence[_Read]) -> list[Samples | None]:
    """Decode the columns of many messages together; None for a message with an unusual value in a column."""
    if not read:
        return []
    bridges, devices, boots, sequences, received, starts, periods, rates, *columns = zip(*read, strict=True)
    ticks, _, accel, celsius, flags = columns
    counts, lengths = (
        [len(column) // 8 for column in ticks],
        ([*map(len, column)] for column in (accel, celsius, flags)),
    )
    numbers = array("q", [*counts, *chain.from_iterable(lengths), *sequences, *starts])
    packed, n, m = bytearray().join(chain.from_iterable(columns)), sum(counts), len(read)
    rows, places, found = np.empty((n, WIDTH)), np.empty((n, 3), np.int64), np.empty((3, m))
    unpacked(
        np.frombuffer(numbers, np.int64).reshape(6, m),
        np.frombuffer(array("d", [*periods, *rates])).reshape(2, m),
        np.frombuffer(packed, "<u8", n),
        np.frombuffer(packed, "<f4"),
        np.frombuffer(packed, "<u4"),
        _LIMITS,
        rows,
        places,
        found,
    )
    first_s, last_s, fits = found.tolist()
    edges = list(pairwise([0, *accumulate(counts)]))
    which = devices, bridges, boots, sequences, counts, first_s, last_s, received, periods, rates
    marked = [column if column.strip(b"\0") else b"" for column in flags]
    parts = [rows[begin:end] for begin, end in edges], [places[begin:end] for begin, end in edges]
    samples = map(Samples._make, zip(*which, ticks, marked, *parts, strict=True))
    return [one if fit else None for one, fit in zip(samples, fits, strict=True)]


def _alone(key: str, payload: bytes) -> Samples | Refusal:
    """Decode one unusual message by itself, so that the codec states the reason for a refusal."""
    try:
        return Samples.of(codec.decode_samples(key, payload))
    except Refusal as refusal:
        return refusal
