"""A device that does as it is told."""

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from bridge.drivers.driver import Event, Identity, Readings
from bridge.ingest.device_thread import DeviceThread
from bridge.ingest.intake import Intake
from bridge.transport.errors import DeviceUnavailable
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally


class Scripted:
    """A driver that does as it is told, then waits."""

    def __init__(self, *script: Exception | Sequence[Event]) -> None:
        self.faults = Tally()
        self.place = "script"
        self.opened = 0
        self._script = list(script)
        self._idle = threading.Event()

    def open(self) -> None:
        self.opened += 1
        if self._script and isinstance(self._script[0], DeviceUnavailable):
            raise self._script.pop(0)  # type: ignore[misc]

    def read(self, timeout_s: float) -> list[Event]:
        if not self._script:
            self._idle.wait(0.01)
            return []
        step = self._script.pop(0)
        if isinstance(step, Exception):
            raise step
        return list(step)

    def close(self) -> None:
        pass


HELLO = Identity(7, BootCause.POWER_UP, "m", "f", 100.0, 0.0, 1e-6, False, False)


def said(sequence: int, n: int = 10) -> Readings:
    ticks = ((sequence + np.arange(n)) * 10_000).astype(np.uint32)
    return Readings(7, sequence, 10**18 + sequence, ticks, np.ones((n, 3)), None, None)


def run(driver: Scripted, until: Callable[[DeviceThread], bool]) -> DeviceThread:
    link = DeviceThread("d1", driver, Intake("d1", "b1", "scripted", "script"))
    link.start()
    end = time.monotonic() + 60
    while not until(link):
        assert time.monotonic() < end
        time.sleep(0.01)
    link.stop()
    return link
