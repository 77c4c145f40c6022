"""One device's thread: open, read, let through the door, and open again, for as long as the bridge runs."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol, runtime_checkable

from bridge import host_time
from bridge.account import News
from bridge.drivers.driver import DeviceLost, DeviceUnavailable, Driver, Event, Notice, Paced, Readings
from bridge.intake import Intake
from bridge.join import joined
from bridge.unheard import ended, why
from bridge.wire.messages import DeviceInfo, SampleBatch

_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 2.0
_READ_S = 0.2
_WATCH_S = 0.5
_KEPT_SAMPLES = 20_000
_AT_ONCE = 256  # samples, or events, before the door is not waited with
_SILENT_S = 3.0

_log = logging.getLogger(__name__)


@runtime_checkable
class Keeps(Protocol):
    """A driver that can be read late: if `keeps`, what its device says waits, stamped, and read_kept never waits for more."""

    keeps: bool

    def read_kept(self, within_s: float) -> list[Event]:
        """What came meanwhile, as much of it as can be understood within_s; raises DeviceLost."""


class Taken(NamedTuple):
    """What the pump takes from a link: batches in order, the boot after them, and whether the device is there.

    boot: 0 while the device has not said who it is. info: the account of it, where it was wanted.
    """

    batches: list[SampleBatch]
    boot: int
    there: bool
    info: DeviceInfo | None


class Link:
    """A device and its thread. `take` may be called from any thread and never waits for the device.

    A device that vanishes is opened again by its own name: each 0.1 s where its driver finds that cheap, as for a port that
    is not plugged in; else ever later, up to 2 s. Batches wait in a bounded queue; when nobody takes them the oldest are
    dropped and counted. turn_s: how long a take may be busy with what waited, so that no device that floods delays others.
    """

    def __init__(self, device: str, driver: Driver, intake: Intake, turn_s: float = 0.025) -> None:
        self.device = device
        self.over = False  # ended for good: a recording that is played
        self._driver = driver
        self._intake = intake
        self._turn_s = turn_s
        self._stop = threading.Event()
        self._ended = threading.Event()  # of a device that is pulled: it is lost, or the bridge stops
        self._error: Exception | None = None
        self._pulled: Keeps | None = None
        self._heard_s = 0.0
        self._lock = threading.RLock()
        self._heard: list[Event] = []  # not yet through the door
        self._unread = 0  # samples of it
        self._queue: deque[SampleBatch] = deque()
        self._queued = 0
        self._there = False
        self._calibrating = self._told = False
        self._faults: dict[str, int] = {}  # a copy, for other threads
        self._complaint = ""
        self._thread = threading.Thread(target=self._run, name=f"device {device}", daemon=True)

    def calibrating(self, on: bool) -> None:  # noqa: FBT001 - it is all there is to say
        """Whether the device is being calibrated now; its driver is told from the thread that reads."""
        self._calibrating = on

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def take(self, wanted: Callable[[int, News], bool] = lambda *_: True) -> Taken:
        """What came since the last take; wanted: whether with an account, of this boot and these news."""
        with self._lock:
            if self._pulled is not None:
                self._pull(self._pulled)
            self._let_in()
            batches = list(self._queue)
            self._queue.clear()
            self._queued = 0
            boot, trouble = self._intake.boot or 0, (self._faults, self._complaint)
            info = self._intake.info(time.time_ns(), *trouble) if wanted(boot, self._intake.news(*trouble)) else None
            return Taken(batches, boot, self._there, info)

    def lose(self, batches: Iterable[SampleBatch]) -> None:
        """Batches that were taken could not be published."""
        with self._lock:
            for batch in batches:
                self._intake.overflowed(batch)

    def stop(self, timeout_s: float = 2.0) -> None:
        """End the thread and close the device; what was read can still be taken."""
        self._stop.set()
        with self._lock:
            if self._pulled is not None:
                self._pull(self._pulled)
        self._ended.set()
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
                if isinstance(self._driver, Keeps) and self._driver.keeps:
                    self._watch(self._driver)
                else:
                    self._read_on()
            except DeviceUnavailable as error:
                if error.soon:
                    wait_s = _FIRST_WAIT_S
                self._complain(str(error))
            except DeviceLost as error:
                if self._there:  # it had been read from, so try again soon
                    wait_s = _FIRST_WAIT_S
                self.over = error.over
                said = ended(self._driver, self._intake.driver) if error.over else ""
                self._complain(said or str(error), wrong=bool(said))
            except Exception as error:  # noqa: BLE001 - a fault of one driver must not silence its device, or the others
                self._complain(f"its driver failed: {error!r}", trace=True)
            finally:
                with self._lock:
                    self._pulled = self._error = None
                self._there = False
                self._driver.close()
                with self._lock:
                    self._let_out()

    def _read_on(self) -> None:
        self._heard_s = time.monotonic()
        while not self._stop.is_set():
            self._pace()
            self._hear(self._driver.read(_READ_S))
            self._look()

    def _watch(self, driver: Keeps) -> None:
        """As _read_on, of a device whose bytes wait until they are taken: it is read by whoever takes."""
        self._heard_s = time.monotonic()
        with self._lock:
            self._ended.clear()
            self._pulled = driver
        while not self._ended.wait(_WATCH_S) and not self._stop.is_set():
            self._look()
        if self._error is not None:
            raise self._error

    def _pull(self, driver: Keeps) -> None:
        try:
            self._pace()
            self._hear(driver.read_kept(self._turn_s))
        except Exception as error:  # noqa: BLE001 - raised where the device is opened again
            self._pulled, self._error = None, error
            self._ended.set()

    def _hear(self, events: list[Event]) -> None:
        with self._lock:
            self._faults = self._driver.faults.as_dict()
            if not events:
                return
            # A driver may have something to say of a device that says nothing.
            if not all(isinstance(event, Notice) for event in events):
                self._heard_s = time.monotonic()
                if not self._there:
                    self._recover()
            self._heard += events
            self._unread += sum(len(event.ticks) for event in events if isinstance(event, Readings))
            if self._unread >= _AT_ONCE or len(self._heard) >= _AT_ONCE:
                self._let_in()

    def _look(self) -> None:
        """Whether it has been silent for long."""
        if time.monotonic() - self._heard_s > _SILENT_S:
            self._there = False
            with self._lock:
                self._let_out()
            self._complain(why(self._driver, self._intake.driver))
            self._heard_s = time.monotonic()

    def _pace(self) -> None:
        on = self._calibrating
        if on != self._told and isinstance(self._driver, Paced):
            self._told = on
            self._driver.calibrating(on)

    def _recover(self) -> None:
        self._there = True
        if self._complaint:
            self._intake.events.add("reconnections")
        _log.info("%s: %s %s", self.device, "back on" if self._complaint else "reading", self._driver.place)
        self._complaint = ""

    def _let_in(self) -> None:
        """What was heard, through the door: of a device that tells time many readings at once, which costs no more than one."""
        heard, self._heard, self._unread = self._heard, [], 0
        self._intake.host_set_ns = host_time.set_ns(self._intake.host_set_ns)
        try:
            for event in joined(heard) if self._intake.has_clock else heard:
                self._keep(self._intake.take(event))
        except Exception as error:  # noqa: BLE001 - in the pump it would silence all devices
            self._complain(f"what it says cannot be taken: {error!r}", trace=True)
        said, self._intake.said = self._intake.said, []
        for words in said:
            # One that is told its rate changes it for every calibration.
            _log.log(logging.INFO if isinstance(self._driver, Paced) else logging.WARNING, "%s: %s", self.device, words)

    def _let_out(self) -> None:
        """Whatever the door still holds back: nothing follows that it could wait for."""
        self._let_in()
        self._keep(self._intake.release())

    def _keep(self, batches: list[SampleBatch]) -> None:
        for batch in batches:
            self._queue.append(batch)
            self._queued += len(batch)
        while self._queued > _KEPT_SAMPLES:
            lost = self._queue.popleft()
            self._queued -= len(lost)
            self._intake.overflowed(lost)

    def _complain(self, complaint: str, *, trace: bool = False, wrong: bool = False) -> None:
        """Say a new trouble aloud, a known one quietly; an end is none, unless something is wrong with it."""
        if self._stop.is_set():
            return
        known = complaint == self._complaint
        level = logging.DEBUG if known else logging.INFO if self.over and not wrong else logging.WARNING
        _log.log(level, "%s: %s", self.device, complaint, exc_info=trace and not known)
        self._complaint = complaint
