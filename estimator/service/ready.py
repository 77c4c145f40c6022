"""What would be ours next is made ready for while there is time: what it is published with, and what corrects it.

Both take longer than all else that is to be done when a device is taken over, and a hundred may be at once.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from functools import partial
from typing import NamedTuple

from bridge.bus.contract import Publisher
from bridge.wire.messages import Checkpoint
from estimator.correction import Correction
from estimator.service.replicas import Replicas

#: devices at most: more wait for their sessions
MOST = 1024
#: seconds after its checkpoint that a device is made ready for: it may be late, and its bias is that much less sure by then
AHEAD_S = 8.0


class _Corrected(NamedTuple):
    by: Checkpoint
    correction: Correction | None


class Ready:
    """Devices that another has, each with what it would be gone on with.

    declare makes the publisher of one; applies tells what corrects it by a checkpoint at a device time, s, if that is known.
    """

    def __init__(
        self,
        replicas: Replicas,
        declare: Callable[[str], Publisher],
        applies: Callable[[Checkpoint, float], Correction | None],
    ) -> None:
        self._replicas, self._declare, self._applies = replicas, declare, applies
        #: devices that are to be made ready for
        self.wanted = set[str]()
        self.publishers = dict[str, Publisher]()
        self._corrected = dict[str, _Corrected]()

    def ahead(self, devices: Collection[str]) -> Iterator[tuple[str, Callable[[], None]]]:
        """What is to be done while there is time, by device, so that less is once these are to be taken over."""
        self.wanted = set(devices)
        for device in [d for d in devices if d not in self.publishers][: MOST - len(self.publishers)]:
            yield device, partial(self._prepare, device)
        for device in [d for d in self.publishers if d not in devices]:
            yield device, partial(self._drop, device)
        for device in [d for d in self.publishers if d in devices and not self._up_to_date(d)]:
            yield device, partial(self._correct, device)

    def _prepare(self, device: str) -> None:
        if device in self.wanted and device not in self.publishers and len(self.publishers) < MOST:
            self.publishers[device] = self._declare(device)
            self._correct(device)

    def _correct(self, device: str) -> None:
        known = self._replicas.of(device)
        if device in self.publishers and known is not None:
            with suppress(Exception):  # whatever it is, who takes it over meets it again, and counts it
                self._corrected[device] = _Corrected(known, self._applies(known, known.device_time_s + AHEAD_S))

    def _up_to_date(self, device: str) -> bool:
        done = self._corrected.get(device)
        return done is not None and done.by is self._replicas.of(device)

    def _drop(self, device: str) -> None:
        self._corrected.pop(device, None)
        if (publisher := self.publishers.pop(device, None)) is not None:
            publisher.close()

    def publisher(self, device: str) -> Publisher:
        """What a device is published with from now on."""
        self._corrected.pop(device, None)
        return self.publishers.pop(device) if device in self.publishers else self._declare(device)

    def correction(self, known: Checkpoint, time: float) -> Correction | None:
        """What corrects a device by the latest checkpoint of it, at a device time."""
        ready = self._corrected.get(known.device)
        if ready is not None and ready.by is known and 0.0 <= time - known.device_time_s <= AHEAD_S:
            return ready.correction
        return self._applies(known, time)

    def close(self) -> None:
        """Take back what is ready."""
        for device in list(self.publishers):
            self._drop(device)
