"""Whom a device is heard from, and what of it can be."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import SampleBatch
from estimator.device.admission import BEGINS, PERSISTS_S, REFUSED, Admission, Ruling
from estimator.samples.sample_buffer import Samples
from tests.estimator.stream import Stream, stream

R = Ruling
#: what a steady clock shows where the machine has been on for a day
UP_S = 86_400.0


@pytest.fixture(scope="module")
def source() -> Stream:
    return stream([], 20.0)


def rule(admission: Admission, batches: Iterable[SampleBatch], *, at: float, step: float) -> list[Ruling]:
    """As the service does, one batch each `step` seconds."""
    rulings = []
    for n, batch in enumerate(map(Samples.of, batches)):
        ruling = admission.judge(batch, at + n * step)
        rulings.append(ruling)
        if ruling in BEGINS:
            admission.sequence.begin(batch.boot)
        if ruling not in REFUSED:
            admission.sequence.fresh(batch)
    return rulings


def test_a_bridge_keeps_its_device_until_it_is_silent() -> None:
    source = Admission(2.0)
    assert source.owns("b1", 0.0)
    assert not source.owns("b2", 1.0)
    assert source.owns("b1", 2.9)
    assert not source.owns("b2", 5.8)
    assert source.owns("b2", 6.0)
    assert not source.owns("b1", 6.1)


def test_an_outage_of_the_bus_gives_a_device_to_nobody_else() -> None:
    source = Admission(2.0)
    assert source.owns("b1", 0.0)
    source.hold(60.0)
    assert not source.owns("b2", 60.5)
    assert source.owns("b1", 61.0)


def test_a_replay_at_a_thousand_times_its_speed_is_taken(source: Stream) -> None:
    # Batches of 50 ms of host time; the clock's rate is known only after some of them.
    fast = [
        replace(
            batch,
            ticks=batch.ticks * np.uint64(1000),
            sequence=n * 5000,
            clock_rate=1.0 if n < 3 else 1e-3,
            receive_time_ns=10**18 + n * 50_000_000,
        )
        for n, batch in enumerate(source.batches(range(5, len(source), 5)))
    ]
    rulings = rule(Admission(2.0), fast[:100], at=UP_S, step=0.05)
    assert rulings == [R.BOOT] + [R.TAKE] * 99


@pytest.mark.parametrize("field", ["sequence", "ticks"])
def test_one_leap_is_refused_and_harms_nothing(source: Stream, field: str) -> None:
    batches = source.batches()
    bad = replace(batches[5], sequence=2**61) if field == "sequence" else leapt(batches[5])
    rulings = rule(Admission(2.0), [*batches[:5], bad, *batches[5:20]], at=UP_S, step=0.1)
    assert rulings == [R.BOOT] + [R.TAKE] * 4 + [R.RANGE] + [R.TAKE] * 15


@pytest.mark.parametrize("field", ["sequence", "ticks"])
def test_a_leap_that_stays_is_followed(source: Stream, field: str) -> None:
    batches = source.batches()
    far = [replace(b, sequence=b.sequence + 2**61) if field == "sequence" else leapt(b) for b in batches[5:60]]
    rulings = rule(Admission(2.0), [*batches[:5], *far], at=UP_S, step=0.1)
    refused = rulings.count(R.RANGE)
    assert refused == pytest.approx(PERSISTS_S / 0.1, abs=2)
    assert rulings[5 + refused :] == [R.JUMP] + [R.TAKE] * (len(far) - refused - 1)


def test_late_and_repeated_batches_are_late_however_many(source: Stream) -> None:
    first, second = source.batches(boot=1), source.batches(boot=2)
    admission = Admission(2.0)
    rule(admission, [*first[:100], *second[:100]], at=UP_S, step=0.1)
    assert set(rule(admission, [*first[:100], *second[:100]], at=20.0, step=0.001)) == {R.LATE}
    # Interleaved with news, for as long as they like.
    mixed = [b for pair in zip(first[:100], second[100:200], strict=True) for b in pair]
    assert set(rule(admission, mixed, at=21.0, step=0.1)) == {R.LATE, R.TAKE}


def test_a_recording_is_late_however_long_it_is_played_while_the_device_is_silent(source: Stream) -> None:
    first, second = source.batches(boot=1), received(source.batches(boot=2), 60.0)
    admission = Admission(2.0)
    rule(admission, [*first, *second], at=UP_S, step=0.1)
    shuffled = [(first + second)[i] for i in np.random.default_rng(1).permutation(len(first) + len(second))]
    for recorded in (first, second, first[100:], shuffled):
        assert set(rule(admission, recorded, at=1000.0, step=0.1)) == {R.LATE}


def test_a_boot_from_before_its_hosts_clock_was_set_back_is_not_waited_for_for_ever(source: Stream) -> None:
    first, second = received(source.batches(boot=1), 3600.0), source.batches(boot=2)
    admission = Admission(2.0)
    rulings = rule(admission, [*first[:50], *second[:60]], at=UP_S, step=0.1)
    late = rulings.count(R.LATE)
    assert late == pytest.approx(PERSISTS_S / 0.1, abs=2)
    assert rulings[50 + late :] == [R.RETURN] + [R.TAKE] * (60 - late - 1)
    # Where the boot before was still heard afterwards, the new one is taken at once.
    back = [replace(b, receive_time_ns=b.receive_time_ns - 2 * 3_600_000_000_000) for b in first[50:60]]
    admission = Admission(2.0)
    rulings = rule(admission, [*first[:50], *back, *second[:60]], at=UP_S, step=0.1)
    assert rulings == [R.BOOT] + [R.TAKE] * 59 + [R.BOOT] + [R.TAKE] * 59


@pytest.mark.parametrize(("start", "back"), [(100, R.RETURN), (0, R.REPEAT)])
def test_a_boot_of_the_past_that_stays_is_not_dead(source: Stream, start: int, back: Ruling) -> None:
    first, second = source.batches(boot=1), source.batches(boot=2)
    admission = Admission(2.0)
    rule(admission, [*first[:100], *second[:5]], at=UP_S, step=0.1)
    again = received(first[start : start + 60], 60.0)
    rulings = rule(admission, again, at=20.0, step=0.1)
    late = rulings.count(R.LATE)
    assert late == pytest.approx(PERSISTS_S / 0.1, abs=2)
    assert rulings[late:] == [back] + [R.TAKE] * (60 - late - 1)


def received(batches: list[SampleBatch], later_s: float) -> list[SampleBatch]:
    return [replace(b, receive_time_ns=b.receive_time_ns + round(later_s * 1e9)) for b in batches]


def leapt(batch: SampleBatch) -> SampleBatch:
    return replace(batch, ticks=batch.ticks + np.uint64(2**61))
