"""Two services on one bus, by hand; the clock stands still but where it is let go on."""

import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import replace

import pytest

from bridge.bus.contract import Message, Subscription
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Command, CommandReply, DeviceInfo, SampleBatch
from estimator.client import Client
from estimator.config.schema import Estimator
from estimator.service.membership import owner
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.stream import NAME, calibration, info
from tests.memory_bus import MemoryBroker, MemoryBus

WARD = "w"
FIRST, SECOND = ("e1", "e2") if owner(NAME, ("e1", "e2")) == "e2" else ("e2", "e1")


class Both:
    """FIRST has the device while it is alone; it is SECOND's where both are there. The clock stands still but for `pass_`."""

    def __init__(self) -> None:
        self.now, self.now_ns = 1000.0, 1_700_000_100_000_000_000
        self.broker = MemoryBroker()
        self.buses: dict[str, MemoryBus] = {}
        self.services: dict[str, Service] = {}
        self.stores: dict[str, Store] = {}
        self.client = Client(ward=WARD, bus=MemoryBus(self.broker))
        self.stream = self.client.corrected(wait_s=1e9)
        bridge = self._asks = MemoryBus(self.broker)
        self._raw = bridge.publisher(keys.build(WARD, "raw", bridge="bridge", device=NAME), cache=500)
        self._kept = bridge.publisher(keys.build(WARD, "checkpoint", device=NAME), cache=1)
        self._info = bridge.publisher(keys.build(WARD, "info", bridge="bridge", device=NAME), cache=1)

    def start(self, name: str, store: Store | None = None) -> None:
        """With a store of its own, be it the one that it had before it was killed."""
        self.buses[name] = bus = MemoryBus(self.broker)
        self.stores[name] = store or Store(":memory:")
        self.services[name] = Service(
            WARD, Estimator(id=name), bus, self.stores[name], lambda: self.now_ns, peers=[*self.services]
        )
        self.told()

    def kill(self, name: str) -> None:
        del self.services[name]
        self.buses.pop(name).detach()
        self.told()

    def told(self) -> None:
        """Each service has heard of all tokens that were born or have died: on a thread of the bus, the last a probe."""
        probe = f"a-probe/{uuid.uuid4().hex}"
        for service in self.services.values():
            service._cluster._watch._changes.put((probe, True))  # type: ignore[attr-defined] # of the bus in memory
        deadline = time.monotonic() + 60.0
        while not all((probe, True) in service._cluster._tokens for service in self.services.values()):
            assert time.monotonic() < deadline
            time.sleep(0.001)
        for service in self.services.values():
            service._cluster._tokens.remove((probe, True))

    def pass_(self, seconds: float, still: str = "") -> None:
        for _ in range(max(1, round(seconds / 0.1))):
            self.now, self.now_ns = self.now + 0.1, self.now_ns + 100_000_000
            for name, service in self.services.items():
                if name != still:
                    service.step(0.0)

    def send(self, batches: list[SampleBatch], still: str = "", what: DeviceInfo | None = None) -> None:
        """Batches of a device, and what it is."""
        self._info.put(codec.encode_info(what or info()))
        for at in range(0, len(batches), 20):
            for batch in batches[at : at + 20]:
                self._raw.put(codec.encode_samples(batch))
            self.pass_(0.1, still)

    def say_checkpoint(self, checkpoint: Checkpoint) -> None:
        """As another estimator would."""
        self._kept.put(codec.encode_checkpoint(checkpoint))

    def part(self) -> list["Cut"]:
        """What keeps either from hearing what the other has, until it is not cut any more."""
        lines = []
        for service in self.services.values():
            service._cluster._heard = line = Cut(service._cluster._heard)  # type: ignore[assignment]
            lines.append(line)
        return lines

    def has(self) -> list[str]:
        return [name for name, service in self.services.items() if NAME in service._devices]

    def command(self, verb: str = "note", request: str = "") -> CommandReply:
        """Ask, and let the services answer."""
        replies: list[CommandReply] = []
        key = keys.build(WARD, "rpc", device=NAME, verb=verb)
        payload = codec.encode_command(Command(request or uuid.uuid4().hex, "nurse", "sat up"))
        asking = threading.Thread(target=lambda: replies.append(codec.decode_reply(self._asks.ask(key, payload))))
        asking.start()
        while asking.is_alive():
            self.pass_(0.1)
            time.sleep(0.005)
        return replies[0]


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Iterator[Both]:
    made = Both()
    for module in ("run_loop", "intake", "cluster", "device", "forgetting"):
        monkeypatch.setattr(f"estimator.service.{module}.time", Clock(made))
    yield made
    for bus in made.buses.values():
        bus.close()


class Clock:
    """The module `time` as services see it."""

    def __init__(self, both: Both) -> None:
        self._both = both
        self.time_ns, self.process_time = time.time_ns, time.process_time

    def monotonic(self) -> float:
        return self._both.now


class Cut:
    """A subscription over a line on which nothing passes for a while; what was said meanwhile comes when it is whole again."""

    def __init__(self, whole: Subscription) -> None:
        self._whole, self.cut = whole, True

    def __getattr__(self, name: str) -> object:
        return getattr(self._whole, name)

    @property
    def caught_up(self) -> bool:
        return not self.cut

    def drain(self, limit: int, timeout_s: float) -> Sequence[Message]:
        return [] if self.cut else self._whole.drain(limit, timeout_s)


@pytest.fixture
def batches() -> list[SampleBatch]:
    return calibration(seed=1, after=[Still(30.0)]).batches()


def fails(*_: object) -> None:
    raise ZeroDivisionError


def powered_up_again(batches: list[SampleBatch]) -> list[SampleBatch]:
    """The same readings under the same boot number, which begin anew a little later."""
    begun, later_ns = batches[0].sequence, 100_000_000_000
    return [
        replace(
            batch,
            sequence=batch.sequence - begun,
            receive_time_ns=batch.receive_time_ns + later_ns,
            start_time_ns=batch.start_time_ns + later_ns,
        )
        for batch in batches
    ]
