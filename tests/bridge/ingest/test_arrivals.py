"""A simulated device, its decoder and the intake: samples that a dead link held up, and a clock that drifts."""

from collections.abc import Callable

import numpy as np
import pytest

from bridge.drivers.native import NativeDecoder
from bridge.ingest.intake import Intake
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Motion, Still
from bridge.sim.sample_source import SimulatedSource
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice
from bridge.wire.messages import SampleBatch, SampleFlag

NOW = 1_700_000_000 * 10**9
TURN_S = 0.01


class Line:
    """A device at rest whose bytes reach an intake; time is an argument."""

    def __init__(self, skew_ppm: float = 0.0) -> None:
        source = SimulatedSource(lambda _: Motion([Still(1.0)]), ImuSpec(step_dps=1 / 131))
        self.device = VirtualDevice("a", source, 1, DeviceSpec(skew_ppm=skew_ppm))
        self.bytes: Callable[[bytes], bytes] = lambda data: data
        self.intake = Intake("a", "b", "native", "line")
        self.batches: list[SampleBatch] = []
        self._decoder, self._turns = NativeDecoder(), 0

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds / TURN_S)):
            self._turns += 1
            data = self.bytes(self.device.advance(self._turns * TURN_S))
            for event in self._decoder.feed(data, NOW + round(self._turns * TURN_S * 1e9)):
                self.batches += self.intake.take(event)

    def marked(self, flag: SampleFlag) -> list[int]:
        """The numbers of the samples with a flag."""
        numbers = [batch.sequence + np.flatnonzero(batch.flags & flag) for batch in self.batches]
        of: list[int] = np.concatenate(numbers).tolist()
        return of


def test_what_a_dead_link_holds_up_is_marked_late_and_nothing_is_lost() -> None:
    line, held = Line(), bytearray()
    line.live(20)

    def hold(data: bytes) -> bytes:
        held.extend(data)
        return b""

    line.bytes = hold
    line.live(5)
    line.bytes = lambda data: bytes(held) + data
    line.live(TURN_S)
    line.bytes = lambda data: data
    line.live(5 - TURN_S)
    late = line.marked(SampleFlag.LATE)
    assert len(late) == pytest.approx(4 * 104, abs=5)
    assert late == list(range(late[0], late[-1] + 1))
    assert line.intake.events.as_dict() == {"late": len(late)}
    assert sum(map(len, line.batches)) == pytest.approx(29.7 * 104, abs=3)
