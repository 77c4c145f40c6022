"""Boots and numbers under attack: wraps, reboots, reopened ports, damaged times, datagrams lost and overtaken, host stalls.

Each sample carries in its gyro which true boot it is of and which number it had, so that whatever comes out can be judged.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.drivers.driver import Event, Readings
from bridge.drivers.sample_assembly import ODD_TIME, DeviceDescription, SampleAssembler
from bridge.ingest.intake import Intake
from bridge.wire.messages import SampleBatch, SampleFlag
from bridge.wire.refusal import Tally

NOW = 1_700_000_000 * 10**9
CLOCKS = [(1e-3, 64), (1e-6, 64), (1e-6, 32), (1e-3, 32), (1e-4, 32)]


@dataclass
class Device:
    """A device at 100 Hz with a clock that counts from power-up, what becomes of its samples, and who they truly are."""

    period_s: float
    bits: int
    first_s: float = 0.0  # where its clock stands at the first power-up
    sent: int = 0
    boots: int = 1
    now_s: float = 0.0
    events: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.faults = Tally()
        self.assembly = SampleAssembler(
            self.faults, DeviceDescription("m", rate_hz=100.0), self.period_s, self.bits, itertools.count(1).__next__
        )
        self.powered_s, self.number, self.stalled_s = -self.first_s, 0, 0.0

    def send(self, n: int, *, lost: bool = False) -> None:
        for _ in range(n):
            (one,) = self.measured(1)
            if not lost:
                self.deliver(one)

    def measured(self, n: int) -> list[tuple[int, int, float]]:
        """The next samples: true boot, true number, device time."""
        made = []
        for _ in range(n):
            self.now_s += 0.01
            made.append((self.boots, self.number, self.now_s - self.powered_s))
            self.number += 1
        return made

    def deliver(self, one: tuple[int, int, float], flip: int = 0) -> None:
        boot, number, time_s = one
        tick = (round(time_s / self.period_s) % 2**self.bits) ^ flip
        at_ns = NOW + round(max(self.now_s, self.stalled_s) * 1e9)
        self.assembly.add(tick, (float(boot), float(number), 0.0), receive_time_ns=at_ns)
        self.sent += 1

    def reboot(self, off_s: float, starts_s: float) -> None:
        """Off and on; its clock begins with power, its samples starts_s later."""
        self.now_s += off_s + starts_s
        self.powered_s, self.number = self.now_s - starts_s, 0
        self.boots += 1

    def said(self) -> list[Event]:
        self.events += self.assembly.events()
        return self.events

    def readings(self) -> list[Readings]:
        return [event for event in self.said() if isinstance(event, Readings)]

    def boots_told(self) -> dict[int, set[int]]:
        """The true boots of each boot that was told."""
        told: dict[int, set[int]] = {}
        for readings in self.readings():
            told.setdefault(readings.boot, set()).update(readings.gyro[:, 0].astype(int).tolist())
        return told

    def check(self) -> None:
        """In is out and counted; no two boots are one; through the door, numbers differ as true numbers do."""
        out = sum(len(readings.ticks) for readings in self.readings())
        assert self.sent == out + self.faults.as_dict().get(ODD_TIME, 0)
        assert all(len(true) == 1 for true in self.boots_told().values()), self.boots_told()
        intake = Intake("d", "b", "x", "p")
        batches: list[SampleBatch] = []
        for event in self.events:
            batches += intake.take(event)
            assert intake.samples_in == intake.samples + intake.dropped.total()
        self.tally = intake
        assert sum(map(len, batches)) <= out
        seen: dict[int, tuple[int, int]] = {}
        for batch in batches:
            numbers = batch.sequence + np.arange(len(batch))
            true = batch.gyro[:, 1].astype(int)
            last, true_last = seen.get(batch.boot, (numbers[0] - 1, true[0] - 1))
            assert numbers[0] > last
            assert bool(batch.flags[0] & SampleFlag.AFTER_GAP) == (numbers[0] != last + 1)
            steps, true_steps = np.diff(numbers, prepend=last), np.diff(true, prepend=true_last)
            np.testing.assert_array_equal(steps, true_steps)
            seen[batch.boot] = int(numbers[-1]), int(true[-1])


def device(clock: tuple[float, int], first_s: float = 0.0) -> Device:
    one = Device(*clock, first_s)
    one.send(200)
    return one


STORY = st.lists(
    st.one_of(
        st.tuples(st.just("send"), st.integers(1, 30)),
        st.tuples(st.just("lose"), st.integers(1, 50)),
        st.tuples(st.just("silent"), st.integers(100, 20_000)),
        st.tuples(st.just("stall"), st.integers(1, 400)),
        st.tuples(st.just("reopen"), st.integers(0, 3000)),
        st.tuples(st.just("overtake"), st.integers(1, 10)),
        st.tuples(st.just("reboot"), st.integers(0, 3000)),
        st.tuples(st.just("said"), st.integers(0, 300)),
    ),
    max_size=25,
)


@settings(max_examples=50)
@given(st.sampled_from(CLOCKS), st.floats(0, 5000), STORY)
def test_whatever_happens_nothing_is_lost_unseen_and_no_two_boots_are_one(
    clock: tuple[float, int], first_s: float, story: list[tuple[str, int]]
) -> None:
    one = device(clock, first_s)
    for what, n in story:
        if what == "send":
            one.send(n)
        elif what in {"lose", "silent"}:
            one.send(n, lost=True)
        elif what == "stall":  # the host is busy, and hears all at once
            one.stalled_s = one.now_s + n * 0.01
            one.send(n)
        elif what == "reopen":
            one.send(n, lost=True)
            one.assembly.opened()
            one.send(5)
        elif what == "overtake":
            first, second = one.measured(n), one.measured(n)
            for sample in (*second, *first):
                one.deliver(sample)
        elif what == "reboot":
            one.reboot(n * 0.01, 0.3)
            one.send(200)
        else:
            one.reboot(n * 0.01, 0.3)
            one.assembly.rebooted()
            one.send(200)
    one.check()


@settings(max_examples=50)
@given(st.sampled_from(CLOCKS), st.floats(0, 5000), st.integers(0, 63), st.integers(0, 99), st.booleans())
def test_a_single_damaged_time_is_never_a_boot(
    clock: tuple[float, int], first_s: float, bit: int, at: int, reopened: bool
) -> None:
    one = device(clock, first_s)
    if reopened:
        one.send(300, lost=True)
        one.assembly.opened()
        at = 0
    for i in range(100):
        (sample,) = one.measured(1)
        one.deliver(sample, flip=1 << bit % clock[1] if i == at else 0)
    one.send(200)
    assert len(one.boots_told()) == 1
    assert sum(len(readings.ticks) for readings in one.readings()) + one.faults.total() == one.sent
    # Numbers go on as if nothing had been; of a time off by almost a period one may seem to be missing.
    last = one.readings()[-1]
    assert last.sequence + len(last.ticks) - 1 == pytest.approx(last.gyro[-1, 1], abs=1)


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize(("up_s", "off_s", "starts_s"), [(1, 0.1, 0.0), (10, 3, 12), (60, 30, 65)])
def test_a_power_cycle_is_a_boot_even_if_the_new_clock_has_come_to_where_the_old_one_was(
    clock: tuple[float, int], up_s: float, off_s: float, starts_s: float
) -> None:
    one = Device(*clock)
    one.send(int(up_s * 100))
    one.reboot(off_s, starts_s)
    one.send(100)
    one.check()
    assert len(one.boots_told()) == 2
    assert one.faults.as_dict() == {ODD_TIME: 2}


@pytest.mark.parametrize("off_s", [3000, 12 * 3600])
@pytest.mark.parametrize("reopened", [False, True])
def test_a_power_cycle_of_hours_is_a_boot_wherever_a_clock_that_wraps_has_come_to(
    *, off_s: float, reopened: bool
) -> None:
    missed = 0
    for up_s in np.linspace(10, 4200, 30):
        one = Device(1e-6, 32)
        one.powered_s = -up_s
        one.send(20)
        one.now_s += off_s
        if reopened:
            one.assembly.opened()
        one.reboot(0, 0)
        one.send(20)
        missed += len(one.boots_told()) < 2
    assert missed <= 1


@pytest.mark.parametrize("off_s", [600, 3000, 8000])
def test_a_device_that_was_out_of_reach_for_hours_is_in_the_same_boot(off_s: float) -> None:
    one = Device(1e-6, 32)
    one.send(100)
    one.now_s += off_s
    one.send(100)
    assert len(one.boots_told()) == 1
    assert one.faults.as_dict() == {}


def test_an_overtaken_datagram_gets_the_numbers_it_should_have_had() -> None:
    one = device((1e-3, 64))
    first, second = one.measured(4), one.measured(4)
    for sample in (*second, *first):
        one.deliver(sample)
    one.send(5)
    one.check()
    assert one.tally.dropped.as_dict() == {"reordered": 4}
    assert one.tally.events.as_dict() == {"gaps": 1, "missing_samples": 4}
