"""The messages of a round read all at once: what is of no use so, or has anything out of the ordinary, goes its own way."""

from functools import cache
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.messages import VERSION, SampleBatch
from estimator.block import ACCEL, GYRO, TIME

Floats = NDArray[np.float64]

_LAST_NS = MAX_TIME_NS - 10**15  # far enough from the end for any batch


class Raw(NamedTuple):
    """What a message says whose columns fit together, and who sent it."""

    device: str
    boot: int
    sequence: int
    receive_time_ns: int
    start_time_ns: int
    tick_period_s: float
    clock_rate: float
    ticks: bytes
    gyro: bytes
    accel: bytes
    celsius: bytes
    bridge: str


class Come(NamedTuple):
    """A batch, the rows (n, 7) of its samples as a block has them, and when the first and last were taken by their clock, s."""

    batch: SampleBatch
    rows: Floats
    first_s: float
    last_s: float


def read(payload: bytes, bridge: str) -> Raw | None:
    """The message, if its columns fit together and nothing of it is out of the ordinary."""
    if len(payload) > MAX_PAYLOAD:
        return None
    try:
        said = columns.SampleBatch.FromString(payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None
    raw = Raw(
        said.device,
        said.boot,
        said.sequence,
        said.receive_time_ns,
        said.start_time_ns,
        said.tick_period_s,
        said.clock_rate,
        said.ticks,
        said.gyro,
        said.accel,
        said.temperature_c,
        bridge,
    )
    _, _, sequence, receive_ns, start_ns, period_s, rate, ticks, gyro, accel, celsius, _ = raw
    size = len(ticks)
    ordinary = (
        said.version == VERSION
        and 8 <= size <= 8 * MAX_SAMPLES
        and size % 8 == 0
        and 2 * len(gyro) == 3 * size
        and (not accel or 2 * len(accel) == 3 * size)
        and (not celsius or 2 * len(celsius) == size)
        and not said.flags
        and sequence <= MAX_SEQUENCE - MAX_SAMPLES
        and 0 < receive_ns < _LAST_NS
        and 0 < start_ns < _LAST_NS
        and 1e-9 <= period_s <= 1.0
        and 1e-4 <= rate <= 1e4
    )
    return raw if ordinary else None


def batches(raws: list[Raw]) -> list[Come]:
    """The messages of a round; none where one value of them is unfit: then each goes its own way."""
    if not raws:
        return []
    packed_ticks, packed_gyro, packed_accel, packed_celsius = (
        b"".join(column) for column in list(zip(*raws, strict=True))[7:11]
    )
    ticks, celsius = np.frombuffer(packed_ticks, "<u8"), np.frombuffer(packed_celsius, "<f4")
    gyro, accel = (np.frombuffer(column, "<f4").reshape(-1, 3) for column in (packed_gyro, packed_accel))
    lengths = np.array([len(raw.ticks) for raw in raws]) // 8
    ends = np.add.accumulate(lengths)
    begins = ends - lengths
    first = np.zeros(len(ticks), bool)
    first[begins] = True
    rising = bool((first[1:] | (ticks[1:] > ticks[:-1])).all()) and int(ticks.max()) < 2**63
    fit = all(within(column, limit) for column, limit in ((gyro, MAX_RATE), (accel, MAX_ACCEL), (celsius, MAX_CELSIUS)))
    if not (rising and fit):
        return []
    rows = np.full((len(ticks), 7), np.nan)
    rows[:, TIME] = ticks * np.repeat([raw.tick_period_s for raw in raws], lengths)
    rows[:, GYRO] = gyro
    rows[np.repeat([bool(raw.accel) for raw in raws], lengths), ACCEL] = accel
    found, pushed, warmed = list[Come](), 0, 0
    places = (column.tolist() for column in (begins, ends, rows[begins, TIME], rows[ends - 1, TIME]))
    for raw, begin, end, first_s, last_s in zip(raws, *places, strict=True):
        force = warmth = None
        n = end - begin
        if raw.accel:
            force, pushed = accel[pushed : pushed + n], pushed + n
        if raw.celsius:
            warmth, warmed = celsius[warmed : warmed + n], warmed + n
        batch = SampleBatch(
            raw.device,
            raw.boot,
            raw.sequence,
            raw.receive_time_ns,
            raw.start_time_ns,
            raw.tick_period_s,
            raw.clock_rate,
            ticks[begin:end],
            gyro[begin:end],
            force,
            warmth,
            _no_flags(n),
            raw.bridge,
        )
        found.append(Come(batch, rows[begin:end], first_s, last_s))
    return found


@cache
def _no_flags(n: int) -> NDArray[np.uint32]:
    flags = np.zeros(n, np.uint32)
    flags.setflags(write=False)
    return flags


def within(column: NDArray[np.float32], limit: float) -> bool:
    """Whether all values are finite and of a magnitude up to limit."""
    return not column.size or bool(np.maximum.reduce(np.abs(column), axis=None) <= limit)
