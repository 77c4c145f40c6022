"""The simulator's faults, from the device through its decoder to the door: each is seen there, and marked or counted."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.drivers.native import NativeDecoder
from bridge.ingest.intake import Intake
from bridge.sim.imperfection import ImuSpec
from bridge.sim.motion import Motion, Still
from bridge.sim.source import Samples, SimulatedSource
from bridge.sim.virtual_device import DeviceSpec, SampleFault, VirtualDevice
from bridge.wire.messages import SampleBatch, SampleFlag

NOW = 1_700_000_000 * 10**9
TURN_S = 0.01


class Line:
    """A device at rest on a line to the door, of which time is an argument."""

    def __init__(self, fault: SampleFault | None = None, skew_ppm: float = 0.0) -> None:
        source = SimulatedSource(lambda _: Motion([Still(1.0)]), ImuSpec(step_dps=1 / 131))
        self.device = VirtualDevice("a", source, 1, DeviceSpec(skew_ppm=skew_ppm))
        self.device.sample_fault = fault
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


def struck(sequence: int, samples: Samples, first: int, n: int) -> NDArray[np.bool_]:
    """Which of the samples have a number from `first` on, and below first + n."""
    number = sequence + np.arange(len(samples))
    return np.asarray((number >= first) & (number < first + n))


def not_a_number(sequence: int, samples: Samples) -> Samples:
    return replace(samples, gyro=np.where(struck(sequence, samples, 500, 3)[:, None], np.nan, samples.gyro))


def colder(sequence: int, samples: Samples) -> Samples:
    return replace(samples, temperature_c=samples.temperature_c - 60 * struck(sequence, samples, 500, 30))


class Frozen:
    """The sensor repeats sample 6000 two hundred times."""

    held: NDArray[np.float64] | None = None

    def __call__(self, sequence: int, samples: Samples) -> Samples:
        which = struck(sequence, samples, 6000, 200)
        if not which.any():
            return samples
        if self.held is None:
            self.held = samples.gyro[which.argmax()].copy()
        return replace(samples, gyro=np.where(which[:, None], self.held, samples.gyro))


def test_a_sensor_that_freezes_is_marked_after_five_repeats() -> None:
    line = Line(Frozen())
    line.live(62)
    assert line.marked(SampleFlag.STUCK) == list(range(6005, 6200))


def test_a_thermometer_that_leaps_is_marked() -> None:
    line = Line(colder)
    line.live(8)
    assert line.marked(SampleFlag.TEMPERATURE_STEP) == list(range(500, 530))


def test_what_is_no_number_is_dropped_and_counted() -> None:
    line = Line(not_a_number)
    line.live(8)
    assert line.intake.dropped.as_dict() == {"non_finite": 3}
    assert line.marked(SampleFlag.AFTER_GAP) == [503]


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


@pytest.mark.parametrize("skew_ppm", [1000.0, -1000.0])
def test_a_clock_that_drifts_is_measured(skew_ppm: float) -> None:
    line = Line(skew_ppm=skew_ppm)
    line.live(20)
    assert line.batches[-1].clock_rate == pytest.approx(1 / (1 + skew_ppm * 1e-6), abs=1e-4)
    host_s = (line.batches[-1].start_time_ns - NOW) * 1e-9
    true_s = line.batches[-1].device_time[0] / (1 + skew_ppm * 1e-6)
    assert host_s == pytest.approx(true_s, abs=TURN_S)


def test_a_reboot_is_a_boot() -> None:
    line = Line()
    line.live(3)
    line.device.reboot()
    line.live(3)
    assert line.intake.events.as_dict() == {"reboots": 1}
    assert len({batch.boot for batch in line.batches}) == 2
