"""What samples teach holds from the next block on."""

import numpy as np
import pytest

from bridge.wire.messages import Quality
from estimator.device.session import DeviceSession
from estimator.samples.blocks import BLOCK_S, SHORT_S, Blocks
from estimator.samples.sample_buffer import SEQUENCE, TIME, Samples
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


def test_blocks_end_at_the_same_samples_however_those_were_batched() -> None:
    whole = calibration(seed=1)
    found = []
    for step in (1, 7, 10, 400):
        blocks, ends = Blocks(0.0), list[int]()
        for batch in whole.batches(list(range(step, len(whole), step))):
            for _, time_s, before_s in blocks.put(Samples.of(batch)):
                assert before_s // blocks.length_s < time_s // blocks.length_s
                begin_end = blocks.end_block()
                ends += [] if begin_end is None else [begin_end[1]]
        found.append(ends)
        np.testing.assert_array_equal(blocks.buffer.rows(0, ends[-1])[:, TIME], whole.time[: ends[-1]])
        np.testing.assert_array_equal(blocks.buffer.places(0, ends[-1])[:, SEQUENCE], np.arange(ends[-1]))
    assert found == [found[0]] * 4
    assert len(found[0]) > 20


def test_device_time_goes_on_where_the_clock_of_the_device_went_back() -> None:
    batches = [Samples.of(batch) for batch in calibration(seed=1).batches()]
    blocks = Blocks(0.0)
    for samples in batches[:20]:
        assert not blocks.went_back(samples.first_s, 0.0)
        for _ in blocks.put(samples):
            blocks.end_block()
    latest = blocks.latest
    assert blocks.went_back(batches[0].first_s, 7.0)
    list(blocks.put(batches[0]))
    assert blocks.latest == pytest.approx(latest + 7.0 + batches[0].last_s - batches[0].first_s)
    assert not blocks.went_back(batches[1].first_s, 0.0)
