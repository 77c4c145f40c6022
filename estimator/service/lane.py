"""The fast lane: batches that only go on where their device was, checked, corrected and encoded many at once.

A batch is plain when it is whole and unmarked and follows the one before without a hole. Unless it ends a half second of its
device correcting is all there is to do. Everything else takes the door and the session's own way, which this one agrees with
to the bit. What one device says keeps its order.
"""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from bridge.bus.contract import Message
from bridge.wire.batches import MAX_CORRECTED
from bridge.wire.messages import SampleBatch
from estimator.block import GYRO
from estimator.correction import Cut
from estimator.gyro import corrected
from estimator.outcome import Outcome
from estimator.service.device import Device
from estimator.service.isolation import Isolation
from estimator.service.roster import MAX_DEVICES
from estimator.service.together import Come, Floats, batches, read, within

_MOST = 2 * MAX_DEVICES
_NOBODY = None, ""


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
        raws = [read(payload, known[key][1]) if key in known else None for key, payload in messages]
        whole = iter(batches([raw for raw in raws if raw is not None]))
        going: dict[str, list[_Plain]] = {}
        for message, raw in zip(messages, raws, strict=True):
            key = message.key
            come = None if raw is None else next(whole, None)
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

    def _end_block(self, device: Device, come: Come, now: float, going_on: list[_Plain]) -> None:
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
        if not within(rate, MAX_CORRECTED):
            for (device, batch, cut, _), n in zip(plain, lengths, strict=True):
                self._guarded(device, device.say_cut, batch, cut, owed=n)
            return
        packed, size, begin = rate.tobytes(), rate.itemsize * 3, 0
        for (device, batch, cut, _), n in zip(plain, lengths, strict=True):
            end = begin + size * n
            self._guarded(device, device.say_rates, batch, cut, packed[begin:end], owed=n)
            begin = end


def _plain(device: Device, come: Come) -> bool:
    """Whether a batch is plain."""
    batch = come.batch
    return (
        batch.device == device.name
        and batch.bridge == device.source.owner
        and device.announced
        and not device.overtaken
        and device.session.plain(batch.boot, batch.sequence, come.first_s, come.last_s)
    )


def _keep(device: Device, come: Come, now: float, going_on: list[_Plain]) -> None:
    batch, rows, _, _ = come
    _heard(device, batch, now)
    session = device.session
    session.keep(batch, rows)
    going_on.append(_Plain(device, batch, Cut(session.applied, 0, len(rows)), rows))


def _heard(device: Device, batch: SampleBatch, now: float) -> None:
    device.heard = now
    device.source.went_on(batch, now)
