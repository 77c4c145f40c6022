"""The messages of a round decoded all at once are what the codec makes of each by itself, or are refused for its reason."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.batches import MAX_SEQUENCE
from bridge.wire.messages import SampleBatch, SampleFlag
from bridge.wire.refusal import Refusal
from bridge.wire.validation import MAX_TIME_NS
from estimator.samples.sample_buffer import Samples
from estimator.service.decode import decode

KEY = keys.build("w", "raw", bridge="b", device="d")


def batch_of(rng: np.random.Generator, n: int, *, accel: bool = True, celsius: bool = False) -> SampleBatch:
    return SampleBatch(
        device="d",
        boot=int(rng.integers(1, 2**64, dtype=np.uint64)),
        sequence=int(2 ** rng.uniform(0, 61)),
        receive_time_ns=int(rng.integers(1, 2**61)),
        start_time_ns=int(rng.integers(1, 2**61)),
        tick_period_s=float(rng.choice([1e-6, 0.01 / 3])),
        clock_rate=float(rng.choice([1.0, 1.00001234])),
        ticks=np.cumsum(rng.integers(1, 1000, n), dtype=np.uint64) + rng.integers(2**50, dtype=np.uint64),
        gyro=rng.normal(0, 9, (n, 3)).astype(np.float32),
        accel=rng.normal(0, 9, (n, 3)).astype(np.float32) if accel else None,
        temperature_c=rng.normal(30, 5, n).astype(np.float32) if celsius else None,
        flags=rng.choice([0, 0, 1, 2, 4, 16], n).astype(np.uint32),
        bridge="b",
    )


def assert_as_the_codec_says(found: Samples | Refusal, payload: bytes) -> None:
    if isinstance(found, Refusal):
        with pytest.raises(Refusal) as refused:
            codec.decode_samples(KEY, payload)
        assert found.reason == refused.value.reason
        return
    expected = Samples.of(codec.decode_samples(KEY, payload))
    for name in Samples._fields:
        mine, theirs = getattr(found, name), getattr(expected, name)
        np.testing.assert_array_equal(mine, theirs, err_msg=name)
        assert type(mine) is type(theirs)


@pytest.mark.parametrize(
    "odd",
    [
        {"flags": np.full(10, 2**20, np.uint32)},
        {"flags": np.full(10, SampleFlag.CLIPPED, np.uint32)},
        {"boot": 0},
        {"sequence": 0},
        {"sequence": MAX_SEQUENCE},
        {"sequence": MAX_SEQUENCE + 1},
        {"receive_time_ns": 0},
        {"receive_time_ns": -5},
        {"start_time_ns": MAX_TIME_NS},
        {"tick_period_s": 0.0},
        {"tick_period_s": np.nan},
        {"tick_period_s": 1.5},
        {"clock_rate": np.inf},
        {"clock_rate": 1e-5},
        {"ticks": np.arange(10, dtype=np.uint64)[::-1]},
        {"ticks": np.zeros(10, np.uint64)},
        {"ticks": np.arange(10, dtype=np.uint64) + np.uint64(2**63 - 5)},
        {"ticks": np.arange(9, dtype=np.uint64)},
        {"ticks": np.zeros(0, np.uint64)},
        {"gyro": np.full((10, 3), np.nan, np.float32)},
        {"gyro": np.full((10, 3), -1001.0, np.float32)},
        {"gyro": np.zeros((9, 3), np.float32)},
        {"accel": np.full((10, 3), np.inf, np.float32)},
        {"accel": np.zeros((11, 3), np.float32)},
        {"temperature_c": np.full(10, 501.0, np.float32)},
        {"temperature_c": np.zeros(9, np.float32)},
        {"device": "e"},
    ],
    ids=lambda odd: next(iter(odd)),
)
def test_what_is_unfit_is_refused_as_by_the_codec_and_its_neighbours_are_not(odd: dict[str, Any]) -> None:
    rng = np.random.default_rng(2)
    payloads = [codec.encode_samples(batch_of(rng, 10)) for _ in range(3)]
    payloads[1] = codec.encode_samples(replace(batch_of(rng, 10), **odd))
    found = decode([Message(KEY, payload) for payload in payloads])
    for one, payload in zip(found, payloads, strict=True):
        assert_as_the_codec_says(one, payload)
    assert isinstance(found[0], Samples)
    assert isinstance(found[2], Samples)


@pytest.mark.parametrize("key", ["nonsense", KEY.replace("raw", "info"), KEY.replace("/d", "/e"), KEY + "/*"])
def test_a_key_that_is_not_that_of_the_samples_is_refused(key: str) -> None:
    payload = codec.encode_samples(batch_of(np.random.default_rng(1), 10))
    (found,) = decode([Message(key, payload)])
    assert isinstance(found, Refusal)
    with pytest.raises(Refusal, match=found.detail[:20].replace("(", ".").replace("*", ".")):
        codec.decode_samples(key, payload)


@given(st.data())
def test_whatever_comes_is_read_as_the_codec_reads_it(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 9)))
    payload = bytearray(codec.encode_samples(batch_of(rng, int(rng.integers(1, 4)), celsius=bool(rng.integers(2)))))
    for _ in range(data.draw(st.integers(1, 3))):
        at, end = (data.draw(st.integers(0, len(payload))) for _ in range(2))
        how = data.draw(st.sampled_from(["changed", "left out", "again", "put in"]))
        if how == "changed" and at < len(payload):
            payload[at] = data.draw(st.integers(0, 255))
        elif how == "left out":
            del payload[at:end]
        elif how == "again":
            payload[at:at] = payload[at:end]
        else:
            payload[at:at] = data.draw(st.binary(max_size=4))
    (found,) = decode([Message(KEY, bytes(payload))])
    assert_as_the_codec_says(found, bytes(payload))
