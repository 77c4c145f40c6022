"""The fast lane: batches that only go on where their device was, checked, corrected and encoded many at once.

A batch is plain when it is whole and unmarked and follows the one before without a hole. Unless it ends a half second of its
device correcting is all there is to do. Everything else takes the door and the session's own way, which this one agrees with
to the bit. What one device says keeps its order.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import MAX_ACCEL, MAX_CELSIUS, MAX_CORRECTED, MAX_RATE, MAX_SAMPLES, MAX_SEQUENCE
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.messages import VERSION, SampleBatch
from estimator.correction import Cut
from estimator.gyro import corrected
from estimator.outcome import Outcome
from estimator.service.device import Device
from estimator.service.isolation import Isolation
from estimator.service.roster import MAX_DEVICES

Floats = NDArray[np.float64]

_LAST_NS = MAX_TIME_NS - 10**15  # far enough from the end for any batch
_MOST = 2 * MAX_DEVICES
_NO_FLAGS = np.zeros(MAX_SAMPLES, np.uint32)
_NO_FLAGS.setflags(write=False)


class _Raw(NamedTuple):
    """A message whose columns fit together, and its n samples.

    begin, pushed, warmed: how many of its round come before it: samples, those with an acceleration, those with a temperature.
    """

    message: Any
    n: int
    begin: int
    pushed: int
    warmed: int


class _Columns(NamedTuple):
    """All samples of a round, one after the other: device time in s."""

    ticks: NDArray[np.uint64]
    gyro: NDArray[np.float32]
    accel: NDArray[np.float32]
    celsius: NDArray[np.float32]
    time: Floats


#: of a plain batch a part, or all of it
Plain = tuple[Device, SampleBatch, Cut]
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
        raws = self._parsed(messages)
        whole = _whole([raw for raw in raws if raw is not None])
        going: dict[str, list[Plain]] = {}
        for message, raw in zip(messages, raws, strict=True):
            if raw is not None and whole is not None:
                device, bridge = self._devices[message.key]
                batch = _plain(device, bridge, raw, whole)
                if batch is not None:
                    self._count(raw.n)
                    taken, going_on = whole.time[raw.begin : raw.begin + raw.n], going.setdefault(message.key, [])
                    take = self._end_block if device.session.ends_block(float(taken[-1])) else _keep
                    self._guarded(device, partial(take, device, batch, taken, going_on), came=raw.n)
                    continue
            self._send(going.pop(message.key, []))
            self._slow(message)
        self._send([plain for held in going.values() for plain in held])

    def _end_block(self, device: Device, batch: SampleBatch, _: Floats, going_on: list[Plain]) -> None:
        _heard(device, batch)
        outcome, cuts = device.session.end_block(batch)
        if outcome.worded:  # after the samples that led to it, and before the first that it is applied to
            self._send(going_on)
            going_on.clear()
        self._tell(device, outcome)
        going_on += [(device, batch, cut) for cut in cuts]

    def _parsed(self, messages: Sequence[Message]) -> list[_Raw | None]:
        raws: list[_Raw | None] = []
        begin = pushed = warmed = 0
        for key, payload in messages:
            raw = _read(payload) if key in self._devices else None
            if raw is None:
                raws.append(None)
                continue
            n = len(raw.ticks) // 8
            raws.append(_Raw(raw, n, begin, pushed, warmed))
            begin += n
            if raw.accel:
                pushed += n
            if raw.temperature_c:
                warmed += n
        return raws

    def _send(self, plain: list[Plain]) -> None:
        """Correct batches and publish them, in order."""
        if not plain:
            return
        lengths = [cut.last - cut.first for _, _, cut in plain]
        models = [cut.correction.model for _, _, cut in plain]
        matrix = np.repeat(np.array([model.matrix for model in models]), lengths, axis=0)
        bias = np.repeat(np.array([model.bias for model in models]), lengths, axis=0)
        reading = np.concatenate([batch.gyro[cut.first : cut.last] for _, batch, cut in plain]).astype(np.float64)
        rate = corrected(reading, matrix, bias).astype("<f4")
        within = _within(rate, MAX_CORRECTED)
        begin = 0
        for (device, batch, cut), n in zip(plain, lengths, strict=True):
            part = rate[begin : begin + n]
            begin += n
            say = partial(device.say_rates, batch, cut, part) if within else partial(device.say_cut, batch, cut)
            self._guarded(device, say, owed=n)


def _keep(device: Device, batch: SampleBatch, taken: Floats, going_on: list[Plain]) -> None:
    _heard(device, batch)
    device.session.keep(batch, taken)
    going_on.append((device, batch, Cut(device.session.applied, 0, len(taken))))


def _heard(device: Device, batch: SampleBatch) -> None:
    device.heard = time.monotonic()
    device.source.went_on(batch, device.heard)


def _read(payload: bytes) -> Any:
    """The message, if its columns fit together and nothing of it is out of the ordinary."""
    if len(payload) > MAX_PAYLOAD:
        return None
    try:
        raw = columns.SampleBatch.FromString(payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning):
        return None
    size = len(raw.ticks)
    ordinary = (
        raw.version == VERSION
        and 8 <= size <= 8 * MAX_SAMPLES
        and size % 8 == 0
        and 2 * len(raw.gyro) == 3 * size
        and (not raw.accel or 2 * len(raw.accel) == 3 * size)
        and (not raw.temperature_c or 2 * len(raw.temperature_c) == size)
        and not raw.flags
        and raw.sequence <= MAX_SEQUENCE - MAX_SAMPLES
        and 0 < raw.receive_time_ns < _LAST_NS
        and 0 < raw.start_time_ns < _LAST_NS
        and 1e-9 <= raw.tick_period_s <= 1.0
        and 1e-4 <= raw.clock_rate <= 1e4
    )
    return raw if ordinary else None


def _whole(there: list[_Raw]) -> _Columns | None:
    """The columns of a round, or None where one value of them is unfit: then each message goes its own way."""
    if not there:
        return None
    ticks = np.frombuffer(b"".join([raw.message.ticks for raw in there]), "<u8")
    gyro = np.frombuffer(b"".join([raw.message.gyro for raw in there]), "<f4").reshape(-1, 3)
    accel = np.frombuffer(b"".join([raw.message.accel for raw in there]), "<f4").reshape(-1, 3)
    celsius = np.frombuffer(b"".join([raw.message.temperature_c for raw in there]), "<f4")
    first = np.zeros(len(ticks), bool)
    first[[raw.begin for raw in there]] = True
    rising = bool((first[1:] | (ticks[1:] > ticks[:-1])).all()) and int(ticks.max()) < 2**63
    fit = all(
        _within(column, limit) for column, limit in ((gyro, MAX_RATE), (accel, MAX_ACCEL), (celsius, MAX_CELSIUS))
    )
    if not (rising and fit):
        return None
    periods = np.repeat([raw.message.tick_period_s for raw in there], [raw.n for raw in there])
    return _Columns(ticks, gyro, accel, celsius, ticks * periods)


def _within(column: NDArray[np.float32], limit: float) -> bool:
    """Whether all values are finite and of a magnitude up to limit."""
    return not column.size or bool(np.maximum.reduce(np.abs(column), axis=None) <= limit)


def _plain(device: Device, bridge: str, raw: _Raw, whole: _Columns) -> SampleBatch | None:
    """The batch, if it is plain."""
    message, n, begin, pushed, warmed = raw
    end = begin + n
    if (
        message.device != device.name
        or device.source.owner != bridge
        or not device.announced
        or device.overtaken
        or not device.session.plain(
            message.boot, message.sequence, float(whole.time[begin]), float(whole.time[end - 1])
        )
    ):
        return None
    return SampleBatch(
        device=device.name,
        boot=message.boot,
        sequence=message.sequence,
        receive_time_ns=message.receive_time_ns,
        start_time_ns=message.start_time_ns,
        tick_period_s=message.tick_period_s,
        clock_rate=message.clock_rate,
        ticks=whole.ticks[begin:end],
        gyro=whole.gyro[begin:end],
        accel=whole.accel[pushed : pushed + n] if message.accel else None,
        temperature_c=whole.celsius[warmed : warmed + n] if message.temperature_c else None,
        flags=_NO_FLAGS[:n],
        bridge=bridge,
    )
