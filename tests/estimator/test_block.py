"""What samples teach holds from the next block on."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import Quality, SampleFlag
from estimator.block import BLOCK_S, SHORT_S, Block, joined, rows_of, sample_time_ns, unfit, where
from estimator.session import DeviceSession
from tests.estimator.stream import NAME, calibration, feed


def test_a_correction_changes_at_the_begin_of_a_second_only_or_of_half_a_one_while_somebody_waits() -> None:
    device, before, awaited_until = DeviceSession(NAME), None, -np.inf
    wholes = halves = 0
    for batch in calibration(seed=1).batches():
        for now in feed(device, [batch]).corrected:
            if device.learnt.awaited:
                awaited_until = batch.device_time[-1]
            if before is not None and not (np.array_equal(now.bias, before.bias) and now.quality == before.quality):
                begins, ended = now.device_time[0], before.device_time[-1]
                assert begins // SHORT_S == ended // SHORT_S + 1
                if begins // BLOCK_S == ended // BLOCK_S:
                    halves += 1
                    assert begins - awaited_until < 2 * SHORT_S
                wholes += 1
            before = now
    assert wholes > 2 * halves > 10
    assert before is not None
    assert before.quality is Quality.GOOD


def test_the_end_of_a_stream_is_learnt_from_without_another_sample() -> None:
    whole = calibration(seed=1)
    ends = [i for i in range(len(whole)) if whole.time[i] // SHORT_S != whole.time[i - 1] // SHORT_S]
    for end in reversed(ends):  # the last block that a calibration needs
        device = DeviceSession(NAME)
        made = feed(device, whole.part(0, end).batches()).calibration
        late = device.end().calibrations
        if made is None:
            assert late
            return
    raise AssertionError("no such end")


def test_what_waits_is_taken_once_and_what_has_no_accelerometer_reads_nan() -> None:
    batches = calibration(seed=1).batches()[:4]
    batches[2] = replace(batches[2], accel=None)
    block = Block()
    for batch in batches:
        block.add(rows_of(batch, 0, len(batch)), None, batch, 0)
    run = joined(block.take())
    assert np.flatnonzero(np.isnan(run.rows).any(axis=1)).tolist() == list(range(20, 30))
    assert run.sequences.tolist() == list(range(40))
    assert block.take() == []
    block.add(rows_of(batches[0], 3, 10), None, batches[0], 3)
    block.add(rows_of(batches[3], 0, 5), None, batches[3], 0)
    assert joined(block.take()).sequences.tolist() == [*range(3, 10), *range(30, 35)]
    np.testing.assert_array_equal(run.time, calibration(seed=1).time[:40])


def test_what_is_unfit_is_told_of_all_samples_where_any_have_flags() -> None:
    batches, block = calibration(seed=1).batches()[:3], Block()
    flags = np.zeros(10, np.uint32)
    flags[2], flags[4], flags[7] = SampleFlag.CLIPPED, SampleFlag.TEMPERATURE_STEP, SampleFlag.STUCK
    for batch, marks in zip(batches, (None, flags, None), strict=True):
        block.add(rows_of(batch, 0, 10), marks, batch, 0)
    parts = block.take()
    told = unfit(parts)
    assert told is not None
    assert (len(told), np.flatnonzero(told).tolist()) == (30, [12, 17])
    assert joined(parts).flags.tolist() == [0] * 10 + flags.tolist() + [0] * 10
    assert unfit([parts[0], parts[2]]) is None


def test_a_sample_is_found_again_in_the_batch_it_came_with() -> None:
    batches = calibration(seed=1).batches()[:4]
    block = Block()
    for batch in batches:
        block.add(rows_of(batch, 3, len(batch)), None, batch, 3)
    for index in (0, 6, 7, 27):
        of, i = block.place(index)
        assert (of.sequence, i) == (10 * (index // 7), 3 + index % 7)
    batch, i = where(of, i)
    assert sample_time_ns(batch, i) == batch.start_time_ns + round((batch.ticks[i] - batch.ticks[0]) * 1e3)
    block.forget(13)
    assert block.place(13) == (batches[1], 9)
    block.forget(14)
    with pytest.raises(IndexError, match="sample 13 "):
        block.place(13)
