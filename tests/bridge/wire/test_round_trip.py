"""What is encoded is decoded back."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.wire import codec, truerate_pb2
from bridge.wire.messages import Command, CommandReply, Note
from bridge.wire.refusal import Reason
from tests.bridge.wire.drawn import (
    CALIBRATION,
    CHECKPOINT,
    CORRECTED,
    INFO,
    INFOS,
    NOTE,
    OWN,
    OWNED,
    RAW,
    REVISION,
    RPC,
    SENTENCES,
    STATUS,
    STATUSES,
    TEXT,
    TIME,
    U64,
    WINDOWED,
    calibrations,
    checkpoints,
    corrected,
    revision,
    samples,
)
from tests.bridge.wire.examples import FIXED, SEEN, assert_same, refused

KINDS: dict[str, tuple[str, Callable[[st.DataObject], Any]]] = {
    "samples": (RAW, samples),
    "corrected": (CORRECTED, corrected),
    "info": (INFO, lambda data: data.draw(INFOS)),
    "status": (STATUS, lambda data: data.draw(STATUSES)),
    "calibration": (CALIBRATION, lambda data: data.draw(calibrations())),
    "revision": (REVISION, revision),
    "owned": (OWN, lambda data: data.draw(OWNED)),
    "checkpoint": (CHECKPOINT, lambda data: data.draw(checkpoints())),
    "note": (NOTE, lambda data: data.draw(st.builds(Note, st.just("d1"), U64, TIME, TEXT, TEXT))),
}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20)
@given(data=st.data())
def test_a_message_is_decoded_as_it_was(kind: str, data: st.DataObject) -> None:
    key, drawn = KINDS[kind]
    message = drawn(data)
    assert_same(getattr(codec, f"decode_{kind}")(key, getattr(codec, f"encode_{kind}")(message)), message)


@settings(max_examples=20)
@given(st.data())
def test_the_rates_alone_are_those_of_the_batch(data: st.DataObject) -> None:
    batch = corrected(data)
    found = codec.decode_rates(CORRECTED, codec.encode_corrected(batch))
    assert found.device == batch.device
    np.testing.assert_array_equal(found.rate, batch.rate)


@pytest.mark.parametrize(
    ("rate", "reason"),
    [
        (np.full((5, 3), np.nan), Reason.NON_FINITE),
        (np.full((5, 3), 1e9), Reason.RANGE),
        (np.zeros((0, 3)), Reason.LENGTH),
        (np.zeros((codec.MAX_SAMPLES + 1, 3)), Reason.LENGTH),
        (np.zeros((5, 2)), Reason.LENGTH),
    ],
)
def test_rates_that_are_none_are_refused(rate: np.ndarray, reason: Reason) -> None:
    bad = codec.encode_corrected(dataclasses.replace(FIXED, rate=rate.astype(np.float32)))
    assert refused(bad, CORRECTED, codec.decode_rates) is reason
    assert refused(bad, RAW, codec.decode_rates) is Reason.BAD_KEY


@settings(max_examples=20)
@given(st.builds(Command, TEXT.filter(bool), TEXT, TEXT), st.builds(CommandReply, TEXT, st.booleans(), SENTENCES))
def test_command_and_reply_round_trip(command: Command, reply: CommandReply) -> None:
    assert codec.decode_command(RPC, codec.encode_command(command)) == command
    assert codec.decode_reply(codec.encode_reply(reply)) == reply
    assert codec.encode_reply(reply)


@settings(max_examples=20)
@given(st.data())
def test_a_twin_writes_the_very_bytes_of_the_real_message(data: st.DataObject) -> None:
    for batch, payload, kind in (
        (one := samples(data), codec.encode_samples(one), truerate_pb2.SampleBatch),
        (two := corrected(data), codec.encode_corrected(two), truerate_pb2.CorrectedBatch),
    ):
        real = kind(version=1)
        for field in dataclasses.fields(batch):
            value = getattr(batch, field.name)
            if field.name == "bridge" or (field.name == "flags" and not value.any()):
                continue  # the key says the bridge
            if isinstance(value, np.ndarray):
                getattr(real, field.name).extend(value.ravel().tolist())
            elif value is not None:
                setattr(real, field.name, value)
        assert real.SerializeToString(deterministic=True) == payload


def test_of_who_does_not_say_by_how_much_a_bias_flickers_it_does_not() -> None:
    """As recordings of earlier versions."""
    one = truerate_pb2.CorrectedBatch.FromString(codec.encode_corrected(FIXED))
    two = truerate_pb2.WindowBatch.FromString(codec.encode_windows(SEEN))
    one.ClearField("flicker_std")
    two.ClearField("flicker_std")
    for found in (
        codec.decode_corrected(CORRECTED, one.SerializeToString()),
        codec.decode_windows(WINDOWED, two.SerializeToString()),
    ):
        np.testing.assert_array_equal(found.flicker_std, np.zeros(3, np.float32))
