"""A device that sends faster while it is calibrated: bridge and estimator in one process, over the bus in memory."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.config import Bridge, Device
from bridge.drivers.simulated import SimulatedOptions
from bridge.ingest.pump import Pump
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, State
from estimator.config import Estimator
from estimator.service.shell import Service
from estimator.service.store import Store

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(120)]
SLOW, FAST = 50.0, 200.0


class Heard:
    """What a subscriber hears, with the rate the device had just then."""

    def __init__(self, broker: MemoryBroker) -> None:
        self._bus = MemoryBus(broker)
        self._info, self._status, self._corrected = (
            self._bus.subscribe(keys.pattern("w", what), history=True) for what in ("info", "status", "corrected")
        )
        self.rate_hz = 0.0
        self.dropped: dict[str, int] = {}
        self.rates: list[float] = []
        self.state = State.UNKNOWN
        self.batches: list[CorrectedBatch] = []

    def hear(self) -> None:
        for message in self._info.drain(1000, 0.0):
            info = codec.decode_info(*message)
            self.rate_hz, self.dropped = info.rate_hz, info.dropped
            if self.rate_hz and self.rates[-1:] != [self.rate_hz]:
                self.rates.append(self.rate_hz)
        for message in self._status.drain(1000, 0.0):
            self.state = codec.decode_status(*message).state
        for message in self._corrected.drain(1000, 0.02):
            self.batches.append(codec.decode_corrected(*message))

    def until(self, what: str, condition: Callable[[], bool], limit_s: float = 40.0) -> None:
        end = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < end, f"{what} did not come: {self.state}, {self.rates}"
            self.hear()


@pytest.fixture
def serving(tmp_path: Path) -> Iterator[tuple[MemoryBroker, Store]]:
    """An estimator that serves."""
    broker, stop, store = MemoryBroker(), threading.Event(), Store(tmp_path / "store.sqlite3")
    with MemoryBus(broker) as data, MemoryBus(broker) as control:
        service = Service("w", Estimator(id="e1"), data, control, store)
        thread = threading.Thread(target=service.run, args=(stop,))
        thread.start()
        yield broker, store
        stop.set()
        thread.join()
    store.close()


def test_one_calibration_at_the_fast_rate_and_good_rates_at_the_chosen_one(serving: tuple[MemoryBroker, Store]) -> None:
    broker, store = serving
    heard = Heard(broker)
    options = SimulatedOptions(seed=3, rate_hz=SLOW, calibration_rate_hz=FAST, speed=10.0)
    config = Bridge(id="b1", batch_ms=20, devices=(Device("d1", "simulated", options),))
    with MemoryBus(broker) as bus, Pump("w", config, bus):
        heard.until("the fast rate", lambda: heard.rate_hz == FAST)
        heard.until("the first turn", lambda: heard.state is State.TURNING)
        assert heard.rate_hz == FAST
        heard.until("the calibration", lambda: heard.state is State.TRACKING)
        heard.until("the chosen rate", lambda: heard.rate_hz == SLOW)
        here = len(heard.batches)
        heard.until("more", lambda: sum(len(batch) for batch in heard.batches[here:]) > 1000)
    [calibration] = store.calibrations("d1")
    assert heard.rates == [SLOW, FAST, SLOW]
    assert calibration.rate_hz == FAST
    assert heard.batches[-1].quality is Quality.GOOD
    assert {batch.calibration for batch in heard.batches if batch.quality is Quality.GOOD} == {calibration.id}
    assert len({batch.boot for batch in heard.batches}) == 1
    numbers = np.concatenate([np.arange(batch.sequence, batch.sequence + len(batch)) for batch in heard.batches])
    assert np.array_equal(numbers, np.arange(numbers[0], numbers[0] + len(numbers)))
    assert heard.dropped == {}
