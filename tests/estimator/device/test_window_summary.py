"""Windows of samples say of them what a plain loop finds, however the samples came."""

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch
from estimator.device.session import DeviceSession
from estimator.device.window_summary import Second, windows
from tests.estimator.stream import NAME, Stream, calibration, handle


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1, after=[Still(4.0)])


def seconds_of(batches: list[SampleBatch]) -> tuple[list[Second], list[CorrectedBatch]]:
    session = DeviceSession(NAME)
    session.windowed = True
    found: list[Second] = []
    corrected: list[CorrectedBatch] = []
    for batch in batches:
        if batch.boot != session.boot:
            session.begin_boot(batch.boot, float(batch.device_time[0]), None)
        outcome = handle(session, batch)
        found += outcome.seconds
        corrected += outcome.corrected
    return found, corrected


def test_each_window_is_what_a_plain_loop_makes_of_its_samples(once: Stream) -> None:
    batches = once.batches()
    seconds, corrected = seconds_of(batches)
    found = windows(seconds)
    rate = np.concatenate([batch.rate for batch in corrected]).astype(float)
    flags = np.concatenate([batch.flags for batch in corrected])
    first = 0
    seen = [(batch, i) for batch in found for i in range(len(batch))]
    for batch, i in seen:
        number = int(batch.sequences[i])
        here = slice(first, number + 1)
        first = number + 1
        assert batch.samples[i] == here.stop - here.start
        tenths = np.unique((once.time[here] * 10 + 1e-6) // 1)
        assert len(tenths) == 1
        for name, values in (("reading", once.gyro[here].astype(np.float32).astype(float)), ("rate", rate[here])):
            wants = {"mean": values.mean(0), "std": values.std(0), "min": values.min(0), "max": values.max(0)}
            for what, want in wants.items():
                np.testing.assert_allclose(getattr(batch, f"{name}_{what}")[i], want, rtol=1e-6, atol=1e-7)
        assert batch.flags[i] == np.bitwise_or.reduce(flags[here])
        assert batch.times_ns[i] == 1_700_000_000_000_000_000 + int(once.ticks[number]) * 1000
    assert first > len(once) - 104
    assert found[-1].quality is Quality.GOOD
    assert {batch.quality for batch in found} > {Quality.GOOD}
    last = next(batch for batch in corrected if batch.sequence + len(batch) > int(found[-1].sequences[-1]))
    np.testing.assert_array_equal(found[-1].bias, last.bias)
    assert (found[-1].rate_mean_std[-1] < last.rate_std[0]).all()
