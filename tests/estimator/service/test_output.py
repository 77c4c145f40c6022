"""Whatever is accepted at the door, every subscriber's door takes what comes of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.wire import codec, keys
from bridge.wire.batches import MAX_CORRECTED
from bridge.wire.messages import BiasRevision, SampleBatch, SampleFlag, Status
from bridge.wire.refusal import Refusal
from bridge.wire.validation import MAX_COUNTS, MAX_TIME_NS
from estimator.config.schema import Estimator
from estimator.device.batch_correction import Cut, batch_of, correct
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples
from estimator.service import output
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.client.test_revision import revision
from tests.estimator.device.test_correction import CALIBRATION, chosen
from tests.estimator.stream import NAME, stream
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import free

KEY = keys.build("w", "status", device=NAME)
RAW = keys.build("w", "raw", bridge="b", device=NAME)
EDGES = st.sampled_from([0, 1, 2**20, 2**40, 2**61, 2**62 - 2000, 2**62])


@st.composite
def batches(draw: st.DrawFn) -> SampleBatch:
    n = draw(st.integers(1, 40))
    step = draw(st.sampled_from([1, 1000, 10_000, 2**30, 2**50]))
    values = st.sampled_from([0.0, 1e-30, -1e-3, 0.5, 999.0, 1000.0, -1000.0])
    gyro = np.tile(np.array(draw(st.tuples(values, values, values)), np.float32), (n, 1))
    if draw(st.booleans()):
        gyro[::2] *= -1
    return SampleBatch(
        device=NAME,
        boot=draw(st.sampled_from([0, 1, 2**64 - 1])),
        sequence=draw(EDGES | st.integers(0, 500)),
        receive_time_ns=draw(EDGES),
        start_time_ns=draw(EDGES),
        tick_period_s=draw(st.sampled_from([1e-9, 1e-6, 1e-3, 1.0])),
        clock_rate=draw(st.sampled_from([1e-4, 1.0, 1e4])),
        ticks=np.uint64(draw(st.integers(0, 2**40))) + np.arange(n, dtype=np.uint64) * np.uint64(step),
        gyro=gyro,
        accel=None if draw(st.booleans()) else np.full((n, 3), draw(st.sampled_from([0.0, 9.81, 1e4])), np.float32),
        temperature_c=None if draw(st.booleans()) else np.full(n, draw(st.sampled_from([-500, 20, 500])), np.float32),
        flags=np.zeros(n, np.uint32),
    )


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(batches(), st.sampled_from([0.0, 0.1, 1.0, 1.5])), min_size=1, max_size=40))
def test_whatever_is_accepted_every_word_that_follows_is_understood(heard: list[tuple[SampleBatch, float]]) -> None:
    broker = MemoryBroker()
    now = [0.0]
    store = Store(":memory:")
    with pytest.MonkeyPatch.context() as patch, MemoryBus(broker) as bus, MemoryBus(broker) as ours:
        patch.setattr("estimator.service.run_loop.time.monotonic", lambda: now[0])
        service = Service("w", Estimator(id="e1"), bus, store, now_ns=lambda: 10**18)
        said = {what: ours.subscribe(keys.pattern("w", what)) for what in ("status", "corrected")}
        raw = ours.publisher(RAW)
        for batch, pause_s in heard:
            try:
                codec.decode_samples(RAW, codec.encode_samples(batch))
            except Refusal:
                continue
            raw.put(codec.encode_samples(batch))
            service.step(0.0)
            now[0] += pause_s
        service._every_second(now[0])
        service.work()
        assert "sessions failed" not in service.counts.as_dict()
        for status in said["status"].drain(10_000, 0.0):
            codec.decode_status(*status)
        for message in said["corrected"].drain(10_000, 0.0):
            codec.decode_corrected(*message)
    store.close()


NUMBER = st.floats() | st.sampled_from([1e6, 1e12, 1e13])
THREE = st.tuples(NUMBER, NUMBER, NUMBER)


@given(NUMBER, NUMBER, NUMBER, NUMBER, THREE, THREE, THREE, st.integers(0, 200))
def test_any_status_is_made_fit(
    rate_hz: float,
    age_s: float,
    temperature_c: float,
    progress: float,
    bias: tuple[float, ...],
    std: tuple[float, ...],
    scale: tuple[float, ...],
    labels: int,
) -> None:
    status = replace(
        DeviceSession(NAME).status(5),
        rate_hz=rate_hz,
        evidence_age_s=age_s,
        temperature_c=temperature_c,
        progress=progress,
        bias=bias,
        bias_std=std,
        scale=scale,
        events={f"label {n}": n + 1 for n in range(labels)} | {"others": 3, "much": 2**70},
    )
    fit: Status = codec.decode_status(KEY, codec.encode_status(output.status(status)))
    assert len(fit.events) <= MAX_COUNTS
    assert fit.events["much"] == 2**64 - 1
    assert sum(fit.events.values()) == labels * (labels + 1) // 2 + 3 + 2**64 - 1


@pytest.mark.parametrize("scale", [3.0, np.inf, np.nan])
def test_a_rate_that_cannot_be_is_said_as_clipped(scale: float) -> None:
    (batch,) = stream([], 3.0).part(0, 20).batches([])
    batch.gyro[3, 1] = 900.0
    right = chosen(CALIBRATION)
    model = replace(right.model, matrix=np.diag([1.0, scale, 1.0]), bias=np.zeros(3))
    cut = Cut(Samples.of(batch), replace(right, model=model, bias_std=np.full(3, 1e9)), 0, 20)
    with np.errstate(all="ignore"):
        payload = codec.encode_corrected(batch_of(cut, *correct([cut])))
    fit = codec.decode_corrected(keys.build("w", "corrected", device=NAME), payload)
    clipped = np.flatnonzero(fit.flags & SampleFlag.CLIPPED).tolist()
    assert clipped == ([3] if scale == 3.0 else list(range(20)))
    assert abs(fit.rate[3, 1]) == MAX_CORRECTED
    np.testing.assert_array_equal(fit.rate[:3, 0], batch.gyro[:3, 0])
    assert fit.start_time_ns < MAX_TIME_NS


REVISION = keys.build("w", "revision", device="d")


@st.composite
def revisions(draw: st.DrawFn) -> BiasRevision:
    n = draw(st.integers(0, 6))
    single = st.floats(width=32) | st.sampled_from([0.0, 0.01, 1001.0])
    vectors = st.lists(st.tuples(single, single, single), min_size=n, max_size=n)
    return revision(
        matrix=draw(st.sampled_from([np.eye(3), np.eye(3), np.full((3, 3), np.nan), np.full((3, 3), 11.0)])),
        sequences=np.array(
            draw(st.lists(st.integers(0, 9) | EDGES | st.just(2**64 - 1), min_size=n, max_size=n)), np.uint64
        ),
        times_ns=np.array(
            draw(st.lists(st.integers(-2, 9) | EDGES | st.just(2**63 - 1), min_size=n, max_size=n)), np.int64
        ),
        bias=np.array(draw(vectors), np.float32).reshape(n, 3),
        bias_std=np.array(draw(vectors), np.float32).reshape(n, 3),
        reason=free(draw(st.text(max_size=600))),
    )


@given(revisions())
def test_any_revision_is_made_fit_or_not_said(said: BiasRevision) -> None:
    fit = output.revision(said)
    if fit is not None:
        assert 2 <= len(codec.decode_revision(REVISION, codec.encode_revision(fit))) <= len(said)
