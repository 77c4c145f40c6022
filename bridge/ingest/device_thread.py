"""Thread of one device: opens the device, reads it, queues its batches, and reopens the device after a loss."""

import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from bridge.drivers.driver import Driver, Event, Notice
from bridge.ingest.intake import Intake
from bridge.ingest.merge_readings import joined
from bridge.ingest.no_data_reason import ended, no_data_reason
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.transport import host_time
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.wire.messages import DeviceInfo, SampleBatch

_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 2.0
_READ_S = 0.2
_KEPT_SAMPLES = 20_000
_SILENT_S = 3.0
_LONGEST_PAUSE_S = 0.05  # data that arrive during the pause must fit into the system's buffers

_log = logging.getLogger(__name__)


class Taken(NamedTuple):
    """Result of `DeviceThread.take`: batches in order, boot number, and state of the device.

    boot: number of the device's current boot; 0 while the device has not identified itself. there: True if the device
    sends data. info: DeviceInfo if requested or at a new boot, else None.
    """

    batches: list[SampleBatch]
    boot: int
    there: bool
    info: DeviceInfo | None


class DeviceThread:
    """Reading thread of one device, with a bounded queue of batches. `take` never waits for the device.

    The thread reads all available data, then pauses until `read_soon` is called, but at most 50 ms. Data that arrive in
    the pause wait in the operating system's buffers, which saves wake-ups.
    When the queue exceeds 20,000 samples, the oldest batches are dropped and counted.
    After a loss, the thread tries to reopen the device. It tries every 0.1 s if the driver reports that an attempt is
    cheap, as for an unplugged port. Otherwise the pauses between attempts grow up to 2 s.
    """

    def __init__(self, device: str, driver: Driver, intake: Intake) -> None:
        self.device = device
        self.over = False  # ended for good, as a replayed recording does
        self._driver = driver
        self._intake = intake
        self._stop = threading.Event()
        self._due = threading.Event()  # set when it is time to read
        self._heard_s = 0.0
        self._lock = threading.Lock()  # guards the intake and the queue
        self._queue: deque[SampleBatch] = deque()
        self._queued = 0
        self._there = False
        self._faults: dict[str, int] = {}  # copy of the driver's faults, for other threads
        self._complaint: Sentences = ()
        self._informed_boot = -1  # boot of the latest DeviceInfo
        self._thread = threading.Thread(target=self._run, name=f"device {device}", daemon=True)

    def start(self) -> None:
        """Start the thread that opens and reads the device."""
        self._thread.start()

    def read_soon(self) -> None:
        """Wake the thread to read now, so that a `take` shortly afterwards finds fresh data."""
        self._due.set()

    def take(self, *, informed: bool = True) -> Taken:
        """Return the batches queued since the last call, and the device's state; never waits for the device.

        May be called from any thread. informed: True returns a DeviceInfo as well; a new boot always includes one.
        """
        with self._lock:
            batches = list(self._queue)
            self._queue.clear()
            self._queued = 0
            boot, info = self._intake.boot or 0, None
            if informed or boot != self._informed_boot:
                self._informed_boot = boot
                info = self._intake.info(time.time_ns(), self._faults, self._complaint)
            return Taken(batches, boot, self._there, info)

    def lose(self, batches: Iterable[SampleBatch]) -> None:
        """Count as dropped the samples of batches that `take` returned but that could not be published."""
        with self._lock:
            for batch in batches:
                self._intake.overflowed(batch)

    def stop(self, timeout_s: float = 2.0, reason: Sentences = ()) -> None:
        """Stop the thread and close the device, waiting up to timeout_s seconds; batches already read can still be taken.

        reason: sentences that state why no more batches will come, for the last DeviceInfo; () if the device may come
        back.
        """
        self._stop.set()
        self._due.set()
        if self._thread.is_alive():
            self._driver.close()  # ends a pending read
            self._thread.join(timeout_s)
            if self._thread.is_alive():
                _log.error("%s: the driver does not stop; its thread keeps running", self.device)
        self._complaint = reason or self._complaint

    def _run(self) -> None:
        wait_s = 0.0
        while not self.over and not self._stop.wait(wait_s):
            wait_s = min(max(2 * wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S)
            try:
                self._driver.open()
                self._read_on()
            except DeviceUnavailable as error:
                if error.soon:
                    wait_s = _FIRST_WAIT_S
                self._complain(error.reason)
            except DeviceLost as error:
                if self._there:  # it was readable, so retry soon
                    wait_s = _FIRST_WAIT_S
                self.over = error.over
                said = ended(self._driver, self._intake.driver) if error.over else ()
                self._complain(said or error.reason, wrong=bool(said))
            except Exception as error:  # noqa: BLE001 - one driver's fault must not end its thread, or stop other devices
                self._complain((Code.DRIVER_FAILED(error=repr(error)),), trace=True)
            finally:
                self._there = False
                self._driver.close()
                self._release()

    def _read_on(self) -> None:
        self._heard_s = time.monotonic()
        while not self._stop.is_set():
            self._hear(self._driver.read(_READ_S))
            self._look()
            self._due.wait(_LONGEST_PAUSE_S)
            self._due.clear()

    def _hear(self, events: list[Event]) -> None:
        """Pass events through the intake, and queue the batches."""
        self._faults = self._driver.faults.as_dict()
        if not events:
            return
        with self._lock:
            # A driver may send notices about a silent device.
            if not all(isinstance(event, Notice) for event in events):
                self._heard_s = time.monotonic()
                if not self._there:
                    self._recover()
            self._intake.host_set_ns = host_time.set_ns(self._intake.host_set_ns)
            # With a device clock, many readings merged cost as much as one.
            for event in joined(events) if self._intake.has_clock else events:
                self._keep(self._intake.take(event))
        said, self._intake.said = self._intake.said, []
        for words in said:
            _log.warning("%s: %s", self.device, words)

    def _release(self) -> None:
        """Queue the readings held because of a possible gap: no more data will settle it."""
        with self._lock:
            self._keep(self._intake.release())

    def _look(self) -> None:
        """Report a device that has been silent for long."""
        if time.monotonic() - self._heard_s > _SILENT_S:
            self._there = False
            self._release()
            self._complain(no_data_reason(self._driver, self._intake.driver))
            self._heard_s = time.monotonic()

    def _recover(self) -> None:
        self._there = True
        if self._complaint:
            self._intake.events.add("reconnections")
        _log.info(
            "%s: %s %s", self.device, "reading again from" if self._complaint else "reading from", self._driver.place
        )
        self._complaint = ()

    def _keep(self, batches: list[SampleBatch]) -> None:
        for batch in batches:
            self._queue.append(batch)
            self._queued += len(batch)
        while self._queued > _KEPT_SAMPLES:
            lost = self._queue.popleft()
            self._queued -= len(lost)
            self._intake.overflowed(lost)

    def _complain(self, complaint: Sentences, *, trace: bool = False, wrong: bool = False) -> None:
        """Log a new trouble as a warning and a repeated one at debug level; a regular end is logged as info."""
        if self._stop.is_set():
            return
        known = complaint == self._complaint
        level = logging.DEBUG if known else logging.INFO if self.over and not wrong else logging.WARNING
        _log.log(level, "%s: %s", self.device, english(*complaint), exc_info=trace and not known)
        self._complaint = complaint
