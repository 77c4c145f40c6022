"""Publishes all devices of one bridge: a thread takes the queue of every device each batch_ms and puts it on the bus."""

import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import Self

from bridge.bus.contract import Bus, BusError, Declared, Publisher
from bridge.config.schema import Bridge, Device
from bridge.ingest.device_thread import DeviceThread, Taken
from bridge.ingest.duplicate_bridges import DuplicateBridges
from bridge.ingest.intake import Intake
from bridge.ingest.merge_batches import merged
from bridge.wire import keys
from bridge.wire.codec import encode_info, encode_samples
from bridge.wire.messages import DeviceInfo, SampleBatch

#: an outage may last: over lines that lose much, one goes on for as long again as it has lasted
_CACHE_S = 30.0
#: messages of a device: of the shortest ones less is kept
_CACHE_MOST = 3000
_INFO_EVERY_S = 1.0
_CHANGES_EVERY_S = 0.2
#: in the time between batches up to so many devices are published in so many shares: all at once, the last would wait for all
#: others at whoever reads. Of more devices there is always something to read, and it costs less when much comes at once
_SPREAD, _SHARES = 128, 8

_log = logging.getLogger(__name__)


def cached(batch_s: float) -> int:
    """The number of messages per device that the publisher keeps for subscribers that missed them, at one each batch_s."""
    return min(max(1, round(_CACHE_S / batch_s)), _CACHE_MOST)


def shares(devices: int) -> int:
    """The number of shares in which so many devices are published, one after the other within batch_ms."""
    return _SHARES if devices <= _SPREAD else 1


class DevicePublisher:
    """One device on the bus: its publishers, and a liveliness token for its current boot."""

    def __init__(self, bus: Bus, ward: str, bridge: str, device: str, cache: int) -> None:
        self._bus = bus
        self._alive_ids = (ward, device)
        self._raw = bus.publisher(keys.build(ward, "raw", bridge=bridge, device=device), cache=cache)
        self._info: Publisher = bus.publisher(keys.build(ward, "info", bridge=bridge, device=device), cache=1)
        self._token: Declared | None = None
        self._token_boot: int | None = None
        self.unsent: deque[SampleBatch] = deque()  # of what was to be published, what was not
        self.said: DeviceInfo | None = None
        self._said_at_s = self._looked_at_s = float("-inf")

    def looks(self, now_s: float) -> bool:
        """Whether it is time to look for changes of the DeviceInfo."""
        due = now_s - self._looked_at_s >= _CHANGES_EVERY_S
        if due:
            self._looked_at_s = now_s
        return due

    def publish(self, taken: Taken, now_s: float, *, last: bool = False) -> None:
        """Batches, with the account of a new boot ahead of its first, and behind the last of all.

        Raises BusError, and then `unsent` has what was not put. The account is of boot 0 while the device has not said
        who it is; where it is not wanted, none is needed.
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
        """Undeclare the publishers and the token."""
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


class Pump:
    """The devices' threads and the thread that publishes, for the length of a `with`; the bus belongs to the caller."""

    def __init__(self, ward: str, config: Bridge, bus: Bus) -> None:
        self._bus = bus
        self._batch_s = config.batch_ms * 1e-3
        cache = cached(self._batch_s)
        self._threads = [_thread(device, config.id) for device in config.devices]
        self._publishers = [DevicePublisher(bus, ward, config.id, thread.device, cache) for thread in self._threads]
        self._all = list(zip(self._threads, self._publishers, strict=True))
        self._duplicates = DuplicateBridges(bus, ward, config.id, (device.id for device in config.devices))
        self._alive = bus.declare_alive(keys.build(ward, "alive/bridge", bridge=config.id))
        self._stop = threading.Event()
        self._complaint = ""
        #: when the pump turned last, monotonic seconds
        self.turned_s = time.monotonic()
        self._pump = threading.Thread(target=self._run, name="pump", daemon=True)

    @property
    def infos(self) -> list[DeviceInfo]:
        """The last DeviceInfo of each device."""
        return [publisher.said for publisher in self._publishers if publisher.said is not None]

    @property
    def over(self) -> bool:
        """Whether every device has ended for good, as recordings do."""
        return all(thread.over for thread in self._threads)

    @property
    def refused(self) -> frozenset[str]:
        """Devices whose samples the estimator takes from another bridge."""
        return frozenset(self._duplicates.refused)

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        self._pump.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop reading, publish the rest, undeclare everything."""
        for thread in self._threads:
            thread.stop()
        self._stop.set()
        self._pump.join()
        self._publish(self._all, last=True)
        for publisher in self._publishers:
            publisher.close()
        self._duplicates.close()
        self._alive.close()

    def _run(self) -> None:
        """Publish one share after the other, each read half of the time between two ahead."""
        parts, due_s = shares(len(self._all)), time.monotonic()
        step_s = self._batch_s / parts
        for turn in itertools.count():
            some = self._all[turn % parts :: parts]
            for thread, _ in some:
                thread.read_soon()
            due_s = max(due_s + step_s / 2, time.monotonic())
            if self._stop.wait(due_s - time.monotonic()):
                return
            self._publish(some)
            due_s = max(due_s + step_s / 2, time.monotonic())
            self._stop.wait(due_s - time.monotonic())

    def _publish(self, some: Iterable[tuple[DeviceThread, DevicePublisher]], *, last: bool = False) -> None:
        self.turned_s = now_s = time.monotonic()
        self._duplicates.hear()
        for thread, publisher in some:
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
                _log.exception("%s: cannot be published", thread.device)

    @staticmethod
    def _lose(thread: DeviceThread, publisher: DevicePublisher) -> None:
        unsent, publisher.unsent = publisher.unsent, deque()
        thread.lose(unsent)


def _news(info: DeviceInfo) -> tuple[object, ...]:
    """The fields that are published soon after a change; the others once a second."""
    return info.boot, info.dropped, info.events, info.trouble


def _thread(device: Device, bridge: str) -> DeviceThread:
    driver = device.make()
    return DeviceThread(device.id, driver, Intake(device.id, bridge, device.driver, driver.place))
