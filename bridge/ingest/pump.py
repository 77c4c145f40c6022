"""Pump: publishes all devices of one bridge. Every batch_ms milliseconds, a thread takes and publishes each device's batches."""

import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Self

from bridge.bus.contract import Bus, BusError, Declared, Publisher
from bridge.config.schema import Bridge, Device
from bridge.ingest.device_thread import DeviceThread, Taken
from bridge.ingest.duplicate_bridges import DuplicateBridges
from bridge.ingest.intake import Intake
from bridge.ingest.merge_batches import merged
from bridge.reasons.codes import Code
from bridge.wire import keys
from bridge.wire.codec import encode_info, encode_samples
from bridge.wire.messages import DeviceInfo, SampleBatch

#: seconds of an outage covered by the publisher's cache; over lossy lines, recovery takes as long again as the outage
_CACHE_S = 30.0
#: messages per device; with very short batches the cache covers less time
_CACHE_MOST = 3000
_INFO_EVERY_S = 1.0
_CHANGES_EVERY_S = 0.2
#: Up to _SPREAD devices are published in _SHARES shares within batch_ms: at once, the last would wait for all others at
#: the subscriber. With more devices a subscriber always has something to read, and bulk is cheaper.
_SPREAD, _SHARES = 128, 8

_log = logging.getLogger(__name__)


def cached(batch_s: float) -> int:
    """Return the number of messages per device that a publisher caches for subscribers that missed them.

    batch_s: time between two messages, s. The cache covers 30 s, but at most 3000 messages.
    """
    return min(max(1, round(_CACHE_S / batch_s)), _CACHE_MOST)


def shares(devices: int) -> int:
    """Return the number of groups into which this many devices are split; groups are published one after the other.

    8 groups for up to 128 devices, else 1.
    """
    return _SHARES if devices <= _SPREAD else 1


class DevicePublisher:
    """Publishes one device on the bus: samples, DeviceInfo, and a liveliness token for its current boot.

    cache: number of sample messages kept for subscribers that missed them.
    """

    def __init__(self, bus: Bus, ward: str, bridge: str, device: str, cache: int) -> None:
        self._bus = bus
        self._alive_ids = (ward, device)
        self._raw = bus.publisher(keys.build(ward, "raw", bridge=bridge, device=device), cache=cache)
        self._info: Publisher = bus.publisher(keys.build(ward, "info", bridge=bridge, device=device), cache=1)
        self._token: Declared | None = None
        self._token_boot: int | None = None
        self.unsent: deque[SampleBatch] = deque()  # batches not yet put on the bus
        self.closed = False
        self.said: DeviceInfo | None = None
        self._said_at_s = self._looked_at_s = float("-inf")

    def looks(self, now_s: float) -> bool:
        """Return True if 0.2 s have passed since the last True: it is time to check for a changed DeviceInfo.

        now_s: seconds of a monotonic clock.
        """
        due = now_s - self._looked_at_s >= _CHANGES_EVERY_S
        if due:
            self._looked_at_s = now_s
        return due

    def publish(self, taken: Taken, now_s: float, *, last: bool = False) -> None:
        """Publish batches and the DeviceInfo. The DeviceInfo of a new boot precedes the boot's first batch.

        taken: the batches and the DeviceInfo; taken.info may be None. A DeviceInfo is published if it shows a change, if
        the last one is 1 s old, or if `last` is True. Its boot is 0 until the device has identified itself.
        now_s: seconds of a monotonic clock. last: True for the last call, before the publisher is closed.
        Raises BusError if publishing fails; `unsent` then holds the batches that were not published.
        """
        self.unsent = deque(merged(taken.batches))
        self._tell_alive(taken.boot if taken.boot and taken.there else None)
        while self.unsent:
            if self.unsent[0].boot == taken.boot:
                self._tell(taken.info, now_s)
            self._raw.put(encode_samples(self.unsent[0]))
            self.unsent.popleft()
        self._tell(taken.info, now_s, at_once=last)

    def close(self) -> None:
        """End the publishers and withdraw the liveliness token."""
        self.closed = True
        self._tell_alive(None)
        self._raw.close()
        self._info.close()

    def _tell(self, info: DeviceInfo | None, now_s: float, *, at_once: bool = False) -> None:
        """Publish a DeviceInfo at a new boot, after a change, once a second, and at once if asked to."""
        if info is None:
            return
        if at_once or now_s - self._said_at_s >= _INFO_EVERY_S or self.said is None or _news(info) != _news(self.said):
            self.said, self._said_at_s = info, now_s
            self._info.put(encode_info(info))

    def _tell_alive(self, boot: int | None) -> None:
        if boot == self._token_boot:
            return
        if self._token is not None:
            self._token.close()
            self._token = None
        ward, device = self._alive_ids
        if boot is not None:
            key = keys.build(ward, "alive/device", device=device, boot=keys.boot_id(boot))
            self._token = self._bus.declare_alive(key)
        self._token_boot = boot


_Running = tuple[DeviceThread, DevicePublisher]


class Pump:
    """Runs a bridge for the length of a `with` block: one thread per device, and one thread that publishes all devices.

    config: the bridge's devices and publishing interval. The caller closes the bus.
    """

    def __init__(self, ward: str, config: Bridge, bus: Bus) -> None:
        self._bus, self._ward, self._bridge = bus, ward, config.id
        self._batch_s = config.batch_ms * 1e-3
        self._devices = dict[Device, _Running]()
        self._all: list[_Running] = []
        #: held while devices are published, so that no publisher is closed meanwhile
        self._publishing = threading.Lock()
        self._duplicates = DuplicateBridges(bus, ward, config.id)
        self._alive = bus.declare_alive(keys.build(ward, "alive/bridge", bridge=config.id))
        self._add(config.devices)
        self._stop = threading.Event()
        self._complaint = ""
        #: monotonic time at which the pump last published, s
        self.turned_s = time.monotonic()
        self._pump = threading.Thread(target=self._run, name="pump", daemon=True)

    @property
    def infos(self) -> list[DeviceInfo]:
        """Last published DeviceInfo of each device that has one."""
        return [publisher.said for _, publisher in self._all if publisher.said is not None]

    @property
    def over(self) -> bool:
        """True if every device has ended for good, as replayed recordings do."""
        return all(thread.over for thread, _ in self._all)

    @property
    def refused(self) -> frozenset[str]:
        """Ids of the devices whose samples the estimator uses from another bridge."""
        return frozenset(self._duplicates.refused)

    def __enter__(self) -> Self:
        for thread, _ in self._all:
            thread.start()
        self._pump.start()
        return self

    def __exit__(self, *exception: object) -> None:
        """Stop reading, publish the rest, undeclare everything."""
        for thread, _ in self._all:
            thread.stop()
        self._stop.set()
        self._pump.join()
        self._publish(self._all, last=True)
        for _, publisher in self._all:
            publisher.close()
        self._duplicates.close()
        self._alive.close()

    def change(self, devices: Sequence[Device]) -> None:
        """Replace the set of devices: stop those that are removed or changed, and start the new ones.

        Unchanged devices keep running. The last samples of a stopped device are published.
        """
        gone = [self._devices.pop(device) for device in self._devices.keys() - set(devices)]
        self._list()
        for thread, publisher in gone:
            thread.stop(reason=(Code.DEVICE_REMOVED(bridge=self._bridge),))
            self._publish([(thread, publisher)], last=True)
            with self._publishing:
                publisher.close()
        for thread, _ in self._add([device for device in devices if device not in self._devices]):
            thread.start()

    def _add(self, devices: Iterable[Device]) -> list[_Running]:
        cache, added = cached(self._batch_s), list[_Running]()
        for device in devices:
            thread = _thread(device, self._bridge)
            self._devices[device] = thread, DevicePublisher(self._bus, self._ward, self._bridge, device.id, cache)
            added.append(self._devices[device])
        self._list()
        return added

    def _list(self) -> None:
        """List the devices for the publishing thread, which reads the list again before each group of devices."""
        self._all = list(self._devices.values())
        self._duplicates.devices = frozenset(device.id for device in self._devices)

    def _run(self) -> None:
        """Publish one group of devices (share) after the other; its devices are woken to read half a step earlier."""
        due_s = time.monotonic()
        for turn in itertools.count():
            parts = shares(len(self._all))
            step_s = self._batch_s / parts
            some = self._all[turn % parts :: parts]
            for thread, _ in some:
                thread.read_soon()
            due_s = max(due_s + step_s / 2, time.monotonic())
            if self._stop.wait(due_s - time.monotonic()):
                return
            self._publish(some)
            due_s = max(due_s + step_s / 2, time.monotonic())
            self._stop.wait(due_s - time.monotonic())

    def _publish(self, some: Iterable[_Running], *, last: bool = False) -> None:
        self.turned_s = now_s = time.monotonic()
        with self._publishing:
            self._duplicates.hear()
            for thread, publisher in some:
                if not publisher.closed:
                    self._publish_one(thread, publisher, now_s, last=last)

    def _publish_one(self, thread: DeviceThread, publisher: DevicePublisher, now_s: float, *, last: bool) -> None:
        try:
            taken = thread.take(informed=last or publisher.looks(now_s))
            publisher.publish(taken, now_s, last=last)
        except BusError as error:
            self._lose(thread, publisher)
            level = logging.DEBUG if str(error) == self._complaint else logging.WARNING
            _log.log(level, "bus: %s", error)
            self._complaint = str(error)
        except Exception:  # noqa: BLE001 - one device's fault must not stop the others
            self._lose(thread, publisher)
            _log.exception("%s: publishing failed", thread.device)

    @staticmethod
    def _lose(thread: DeviceThread, publisher: DevicePublisher) -> None:
        unsent, publisher.unsent = publisher.unsent, deque()
        thread.lose(unsent)


def _news(info: DeviceInfo) -> tuple[object, ...]:
    """Fields whose changes are published soon; other fields follow once a second."""
    return info.boot, info.dropped, info.events, info.trouble


def _thread(device: Device, bridge: str) -> DeviceThread:
    driver = device.make()
    return DeviceThread(device.id, driver, Intake(device.id, bridge, device.driver, driver.place))
