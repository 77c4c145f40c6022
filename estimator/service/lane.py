"""The fast lane: batches that only go on where their device was, checked, corrected and encoded many at once.

A batch is plain when it is whole and unmarked and follows the one before without a hole. Unless it ends a half second of its
device correcting is all there is to do. Everything else takes the door and the session's own way, which this one agrees with
to the bit. What one device says keeps its order.
"""

import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_CORRECTED, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.messages import VERSION, SampleBatch
from estimator.block import ACCEL, GYRO, TIME
from estimator.correction import Cut
from estimator.gyro import corrected
from estimator.outcome import Outcome
from estimator.service.device import Device
from estimator.service.isolation import Isolation
from estimator.service.roster import MAX_DEVICES

Floats = NDArray[np.float64]

_LAST_NS = MAX_TIME_NS - 10**15  # far enough from the end for any batch
_MOST = 2 * MAX_DEVICES
_NOBODY = None, ""


class _Raw(NamedTuple):
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


class _Come(NamedTuple):
    """A batch, the rows (n, 7) of its samples as a block has them, and when the first and last were taken by their clock, s."""

    batch: SampleBatch
    rows: Floats
    first_s: float
    last_s: float


class _Plain(NamedTuple):
    """Of a plain batch a part, or all of it, and its rows (n, 7)."""

    device: Device
    batch: SampleBatch
    cut: Cut
    rows: Floats


Tell = Callable[[Device, Outcome], None]


class Lane:
    """Devices by the key of their raw samples; `take` does what is plain and hands the rest to `slow`, in order.

    guarded does some work of one device; tell publishes what a batch led to;
    count takes the number of samples in each batch that does not take the door.
    """

    def __init__(
        self, slow: Callable[[Message], None], guarded: Isolation, tell: Tell, count: Callable[[int], None]
    ) -> None:
        self._slow, self._guarded, self._tell, self._count = slow, guarded, tell, count
        self._devices: dict[str, tuple[Device, str]] = {}

    def admit(self, key: str, device: Device, bridge: str) -> None:
        """What comes under this key is of this device, from this bridge."""
        if len(self._devices) >= _MOST:
            self._devices.clear()  # of devices that are no more, too; those that are will be admitted again
        self._devices[key] = device, bridge

    def dismiss(self, device: Device) -> None:
        """It is ours no more."""
        for key in [key for key, (admitted, _) in self._devices.items() if admitted is device]:
            del self._devices[key]

    def take(self, messages: Sequence[Message]) -> None:
        """A round of messages."""
        now, known = time.monotonic(), self._devices
        raws = [_read(payload, known[key][1]) if key in known else None for key, payload in messages]
        batches = iter(_batches([raw for raw in raws if raw is not None]))
        going: dict[str, list[_Plain]] = {}
        for message, raw in zip(messages, raws, strict=True):
            key = message.key
            come = None if raw is None else next(batches, None)
            device, _ = known.get(key, _NOBODY)
            if come is not None and device is not None and _plain(device, come):
                n, going_on = len(come.rows), going.setdefault(key, [])
                self._count(n)
                take = self._end_block if device.session.ends_block(come.last_s) else _keep
                self._guarded(device, take, device, come, now, going_on, came=n)
            else:
                self._send(going.pop(key, []))
                self._slow(message)
        self._send([plain for held in going.values() for plain in held])

    def _end_block(self, device: Device, come: _Come, now: float, going_on: list[_Plain]) -> None:
        batch, rows, _, _ = come
        _heard(device, batch, now)
        outcome, cuts = device.session.end_block(batch, rows)
        if outcome.worded:  # after the samples that led to it, and before the first that it is applied to
            self._send(going_on)
            going_on.clear()
        self._tell(device, outcome)
        going_on += [_Plain(device, batch, cut, rows[cut.first : cut.last]) for cut in cuts]

    def _send(self, plain: list[_Plain]) -> None:
        """Correct batches and publish them, in order."""
        if not plain:
            return
        lengths = [len(one.rows) for one in plain]
        parameters = np.repeat(np.array([one.cut.correction.parameters for one in plain]), lengths, axis=0)
        reading = np.concatenate([one.rows for one in plain])[:, GYRO]
        rate = corrected(reading, parameters[:, :9].reshape(-1, 3, 3), parameters[:, 9:]).astype("<f4")
        if not _within(rate, MAX_CORRECTED):
            for (device, batch, cut, _), n in zip(plain, lengths, strict=True):
                self._guarded(device, device.say_cut, batch, cut, owed=n)
            return
        packed, size, begin = rate.tobytes(), rate.itemsize * 3, 0
        for (device, batch, cut, _), n in zip(plain, lengths, strict=True):
            end = begin + size * n
            self._guarded(device, device.say_rates, batch, cut, packed[begin:end], owed=n)
            begin = end


def _plain(device: Device, come: _Come) -> bool:
    """Whether a batch is plain."""
    batch = come.batch
    return (
        batch.device == device.name
        and batch.bridge == device.source.owner
        and device.announced
        and not device.overtaken
        and device.session.plain(batch.boot, batch.sequence, come.first_s, come.last_s)
    )


def _keep(device: Device, come: _Come, now: float, going_on: list[_Plain]) -> None:
    batch, rows, _, _ = come
    _heard(device, batch, now)
    session = device.session
    session.keep(batch, rows)
    going_on.append(_Plain(device, batch, Cut(session.applied, 0, len(rows)), rows))


def _heard(device: Device, batch: SampleBatch, now: float) -> None:
    device.heard = now
    device.source.went_on(batch, now)


def _read(payload: bytes, bridge: str) -> _Raw | None:
    """The message, if its columns fit together and nothing of it is out of the ordinary."""
    if len(payload) > MAX_PAYLOAD:
        return None
    try:
        said = columns.SampleBatch.FromString(payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None
    raw = _Raw(
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


def _batches(raws: list[_Raw]) -> list[_Come]:
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
    fit = all(
        _within(column, limit) for column, limit in ((gyro, MAX_RATE), (accel, MAX_ACCEL), (celsius, MAX_CELSIUS))
    )
    if not (rising and fit):
        return []
    rows = np.full((len(ticks), 7), np.nan)
    rows[:, TIME] = ticks * np.repeat([raw.tick_period_s for raw in raws], lengths)
    rows[:, GYRO] = gyro
    rows[np.repeat([bool(raw.accel) for raw in raws], lengths), ACCEL] = accel
    found, pushed, warmed = list[_Come](), 0, 0
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
        found.append(_Come(batch, rows[begin:end], first_s, last_s))
    return found


@cache
def _no_flags(n: int) -> NDArray[np.uint32]:
    flags = np.zeros(n, np.uint32)
    flags.setflags(write=False)
    return flags


def _within(column: NDArray[np.float32], limit: float) -> bool:
    """Whether all values are finite and of a magnitude up to limit."""
    return not column.size or bool(np.maximum.reduce(np.abs(column), axis=None) <= limit)
