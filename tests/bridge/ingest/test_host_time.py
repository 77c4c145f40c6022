"""Who sets the host's clock while the bridge runs changes what time is published, and nothing else."""

import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from bridge.config.schema import Device
from bridge.drivers.byte_stream import StreamDriver
from bridge.ingest import sample_clock
from bridge.ingest.device_thread import DeviceThread
from bridge.ingest.intake import Intake
from bridge.transport import address, host_time
from bridge.transport.transport import Chunk
from bridge.wire.messages import SampleBatch
from bridge.wire.refusal import Tally

HOUR_NS = 3600 * 10**9
FEW_NS = 60 * 10**9  # a busy machine is late


class Line:
    """A port on which a device says something a hundred times a second."""

    place = "a line"

    def __init__(self) -> None:
        self.faults = Tally()
        self.said, self.begun_s = 0, time.monotonic()

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        pass

    def read(self, timeout_s: float) -> Chunk:
        time.sleep(min(timeout_s, 0.01))
        before, self.said = self.said, int(100 * (time.monotonic() - self.begun_s))
        lines = [f"{5000 + 10 * n},0,0,1,{n % 7},2,3,0,0,0\r\n" for n in range(before, self.said)]
        return Chunk("".join(lines).encode(), host_time.now_ns())


def heard(link: DeviceThread, enough: Callable[[list[SampleBatch]], bool]) -> list[SampleBatch]:
    batches, until = list[SampleBatch](), time.monotonic() + 60
    while not enough(batches):
        assert time.monotonic() < until, batches
        batches += link.take().batches
        time.sleep(0.02)
    return batches


@pytest.mark.parametrize("set_ns", [HOUR_NS, -HOUR_NS])
def test_a_clock_that_is_set_is_neither_a_boot_nor_a_gap(set_ns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(address, "transport", lambda *_: Line())
    monkeypatch.setattr(sample_clock, "_LATE_NS", FEW_NS)
    driver = Device.from_table(
        {"id": "a", "driver": "text_profile", "port": "tcp://127.0.0.1:9", "profile": "razor-m0"}
    ).make()
    assert isinstance(driver, StreamDriver)
    link = DeviceThread("a", driver, Intake("a", "b", "text", "a line"))
    link.start()
    before = heard(link, lambda batches: sum(map(len, batches)) > 50)
    last = before[-1]

    def is_set(batch: SampleBatch) -> bool:
        times_ns = batch.start_time_ns - last.start_time_ns, batch.receive_time_ns - last.receive_time_ns
        return times_ns == pytest.approx((set_ns, set_ns), abs=FEW_NS)

    moved = SimpleNamespace(time_ns=lambda: time.time_ns() + set_ns, clock_gettime_ns=time.clock_gettime_ns)
    monkeypatch.setattr(host_time, "time", moved)
    after = heard(link, lambda batches: sum(len(batch) for batch in batches if is_set(batch)) > 50)
    link.stop()
    marks = [is_set(batch) for batch in after]  # the first may be of the time before
    assert marks == sorted(marks)
    assert len({batch.boot for batch in before + after}) == 1
    info = link.take().info
    assert info is not None
    assert not {"odd_time", "missing_samples", "gaps", "late"} & info.events.keys(), info.events
    assert np.all(np.diff(np.concatenate([batch.ticks for batch in before + after]).astype(np.int64)) == 10)
