"""One device's thread: open, read, let through the door, and open again, for as long as the bridge runs."""

import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from bridge.drivers.driver import DeviceLost, DeviceUnavailable, Driver
from bridge.intake import Intake
from bridge.wire.messages import DeviceInfo, SampleBatch

_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 2.0
_READ_S = 0.2
_KEPT_SAMPLES = 20_000
_SILENT_S = 3.0

_log = logging.getLogger(__name__)


class Taken(NamedTuple):
    """What the pump takes from a link: batches in order, the account after them, and whether the device is there."""

    batches: list[SampleBatch]
    info: DeviceInfo
    there: bool


class Link:
    """A device and its thread. `take` may be called from any thread and never waits for the device.

    A device that vanishes is opened again by its own name: after 0.1 s, then ever later, up to 2 s. Batches wait in a
    bounded queue; when nobody takes them the oldest are dropped and counted.
    """

    def __init__(self, device: str, driver: Driver, intake: Intake) -> None:
        self.device = device
        self.over = False  # ended for good: a recording that is played
        self._driver = driver
        self._intake = intake
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._queue: deque[SampleBatch] = deque()
        self._queued = 0
        self._there = False
        self._faults: dict[str, int] = {}  # a copy, for other threads
        self._complaint = ""
        self._thread = threading.Thread(target=self._run, name=f"device {device}", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def take(self) -> Taken:
        """What came since the last take."""
        with self._lock:
            batches = list(self._queue)
            self._queue.clear()
            self._queued = 0
            return Taken(batches, self._intake.info(time.time_ns(), self._faults, self._complaint), self._there)

    def lose(self, batches: Iterable[SampleBatch]) -> None:
        """Batches that were taken could not be published."""
        with self._lock:
            for batch in batches:
                self._intake.overflowed(batch)

    def stop(self, timeout_s: float = 2.0) -> None:
        """End the thread and close the device; what was read can still be taken."""
        self._stop.set()
        if self._thread.is_alive():
            self._driver.close()  # ends a read
            self._thread.join(timeout_s)
            if self._thread.is_alive():
                _log.error("%s: its driver does not end", self.device)

    def _run(self) -> None:
        wait_s = 0.0
        while not self.over and not self._stop.wait(wait_s):
            wait_s = min(max(2 * wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S)
            try:
                self._driver.open()
                self._read_on()
            except DeviceUnavailable as error:
                self._complain(str(error))
            except DeviceLost as error:
                if self._there:  # it had been read from, so try again soon
                    wait_s = _FIRST_WAIT_S
                self.over = error.over
                self._complain(str(error))
            except Exception as error:  # noqa: BLE001 - a fault of one driver must not silence its device, or the others
                self._complain(f"its driver failed: {error!r}", trace=True)
            finally:
                self._there = False
                self._driver.close()
                with self._lock:
                    self._keep(self._intake.release())

    def _read_on(self) -> None:
        heard_s = time.monotonic()
        while not self._stop.is_set():
            events = self._driver.read(_READ_S)
            with self._lock:
                self._faults = self._driver.faults.as_dict()
                if events and not self._there:
                    self._recover()
                for event in events:
                    self._keep(self._intake.take(event))
            if events:
                heard_s = time.monotonic()
            elif time.monotonic() - heard_s > _SILENT_S:
                self._there = False
                with self._lock:
                    self._keep(self._intake.release())
                self._complain(
                    f"{self._driver.place}: open, but nothing that is understood comes; on, and the right speed?"
                )

    def _recover(self) -> None:
        self._there = True
        if self._complaint:
            self._intake.events.add("reconnections")
        _log.info("%s: %s %s", self.device, "back on" if self._complaint else "reading", self._driver.place)
        self._complaint = ""

    def _keep(self, batches: list[SampleBatch]) -> None:
        for batch in batches:
            self._queue.append(batch)
            self._queued += len(batch)
        while self._queued > _KEPT_SAMPLES:
            lost = self._queue.popleft()
            self._queued -= len(lost)
            self._intake.overflowed(lost)

    def _complain(self, complaint: str, *, trace: bool = False) -> None:
        """Say a new trouble aloud, a known one quietly."""
        if self._stop.is_set():
            return
        known = complaint == self._complaint
        level = logging.DEBUG if known else logging.INFO if self.over else logging.WARNING
        _log.log(level, "%s: %s", self.device, complaint, exc_info=trace and not known)
        self._complaint = complaint
