"""Cursor of a stream reader in a buffer of batches: returns each sample once, in order, and reports missed ones. Pure."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

from bridge.wire.messages import CorrectedBatch
from estimator.samples.mean_rates import MeanRates


class Place(NamedTuple):
    """Position of a reader in a device's samples: the boot id, and the number in it of the next sample to read."""

    boot: int
    next: int


@dataclass(frozen=True, slots=True)
class Missed:
    """Samples of a boot that a reader does not get: `count` samples from number `first` on.

    count: None means an unknown number, up to the end of the boot.
    """

    device: str
    boot: int
    first: int
    count: int | None


class Kept:
    """Buffer of the last `most` corrected batches of a subscription, in order of arrival; older ones are dropped.

    `end`: number of batches ever added.
    """

    def __init__(self, most: int) -> None:
        self.batches: deque[CorrectedBatch] = deque(maxlen=most)
        #: number of batches ever added
        self.end = 0

    @property
    def begin(self) -> int:
        """Number of dropped batches, which is the index of the first kept batch."""
        return self.end - len(self.batches)

    def add(self, batches: Iterable[CorrectedBatch]) -> None:
        """Append batches, which must contain each sample once and in order."""
        for batch in batches:
            self.batches.append(batch)
            self.end += 1


@dataclass(slots=True)
class _Device:
    place: Place
    #: batches are forgotten since, so the end of the boot may be missed
    torn: bool = False
    means: MeanRates | None = None


class Cursor:
    """Cursor of one reader: reads the batches of a buffer whole, or reduced to `hz` mean values a second.

    kept: the buffer. after: position from which to resume, by device; other devices begin with the first sample in the
    buffer. None: all devices begin with the first sample that arrives from now on.
    `places`: by device, the position from which a later cursor can resume.
    """

    def __init__(self, kept: Kept, after: Mapping[str, Place] | None = None, hz: float | None = None) -> None:
        self._kept, self._hz = kept, hz
        resumed = after is not None
        self._position = kept.begin if resumed else kept.end
        self._live_at = kept.end
        #: boots of the places to resume from that are kept and not yet reached; batches before them are known
        self._awaited = set[tuple[str, int]]()
        if after is None:
            after = {batch.device: Place(batch.boot, batch.sequence + len(batch)) for batch in kept.batches}
        else:
            wanted = {(device, place.boot) for device, place in after.items()}
            self._awaited = wanted & {(batch.device, batch.boot) for batch in kept.batches}
        self._devices = {
            device: _Device(place, torn=resumed and (device, place.boot) not in self._awaited)
            for device, place in after.items()
        }
        self.places = dict(after)

    @property
    def behind(self) -> bool:
        """True if the buffer has batches that this cursor has not read."""
        return self._position < self._kept.end

    def read(self, most: int) -> list[CorrectedBatch | Missed]:
        """Return the batches that follow this cursor's position, with reports of missed samples; may be empty.

        most: largest number of batches to take from the buffer.
        """
        if self._position < self._kept.begin:
            self._position = self._kept.begin
            for device in self._devices.values():
                device.torn = True
        at = self._position - self._kept.begin
        found: list[CorrectedBatch | Missed] = []
        for batch in islice(self._kept.batches, at, at + most):
            for one in self._next(batch, past=self._position < self._live_at):
                begin = one.sequence + len(one) if isinstance(one, CorrectedBatch) else batch.sequence
                boot = one.boot if isinstance(one, CorrectedBatch) else batch.boot
                self.places[batch.device] = Place(boot, begin)
                found.append(one)
            self._position += 1
        return found

    def _next(self, batch: CorrectedBatch, *, past: bool) -> list[CorrectedBatch | Missed]:
        device = self._devices.get(batch.device)
        if device is None:
            device = self._devices[batch.device] = _Device(Place(batch.boot, batch.sequence))
        boot, number = device.place
        found: list[CorrectedBatch | Missed] = []
        if batch.boot == boot:
            self._awaited.discard((batch.device, boot))
            if past and (known := number - batch.sequence) > 0:
                if known >= len(batch):
                    return []
                batch = batch.after(known)
            if batch.sequence > number:
                found = [*self._ended(device), Missed(batch.device, boot, number, batch.sequence - number)]
        elif (batch.device, boot) in self._awaited:
            return []
        elif device.torn:
            found = [*self._ended(device), Missed(batch.device, boot, number, None)]
        device.place, device.torn = Place(batch.boot, batch.sequence + len(batch)), False
        return [*found, *self._thinned(device, batch)]

    def _thinned(self, device: _Device, batch: CorrectedBatch) -> list[CorrectedBatch]:
        if self._hz is None:
            return [batch]
        if device.means is None:
            device.means = MeanRates(self._hz)
        return device.means.add(batch)

    @staticmethod
    def _ended(device: _Device) -> list[CorrectedBatch]:
        return device.means.flush() if device.means is not None else []
