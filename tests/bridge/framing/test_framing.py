import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.framing.cobs_frames import MAX_PAYLOAD, Deframer, frame
from bridge.framing.packets import (
    MAX_SAMPLES,
    BadPacket,
    Data,
    Hello,
    decode,
    encode_data,
    encode_hello,
    encode_identify,
)

payloads = st.binary(min_size=1, max_size=300)
float32s = st.floats(width=32, allow_nan=True)
names = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=64)
hellos = st.builds(
    Hello,
    boot=st.integers(0, 2**64 - 1),
    tick_period_s=st.floats(1e-9, 1),
    rate_hz=st.floats(0.1, 100_000),
    gyro_range=st.floats(0, 1000),
    has_accel=st.booleans(),
    has_temperature=st.booleans(),
    model=names,
    firmware=names,
)


@st.composite
def datas(draw: st.DrawFn) -> Data:
    n = draw(st.integers(1, MAX_SAMPLES))
    column = st.lists(float32s, min_size=3 * n, max_size=3 * n)
    return Data(
        boot=draw(st.integers(0, 2**64 - 1)),
        sequence=draw(st.integers(0, 2**32 - 1)),
        ticks=np.array(draw(st.lists(st.integers(0, 2**32 - 1), min_size=n, max_size=n)), np.uint32),
        gyro=np.array(draw(column), np.float32).reshape(n, 3),
        accel=np.array(draw(column), np.float32).reshape(n, 3),
        temperature_c=np.array(draw(column)[:n], np.float32),
    )


packets = st.one_of(hellos.map(encode_hello), datas().map(encode_data))


@given(st.lists(payloads, max_size=8), st.data())
def test_any_chunking_gives_the_same_payloads(sent: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(frame(one) for one in sent)
    deframer = Deframer()
    got: list[bytes] = []
    while stream:
        cut = data.draw(st.integers(1, len(stream)))
        got += deframer.feed(stream[:cut])
        stream = stream[cut:]
    assert got == sent
    assert deframer.faults.total() == 0


@given(payloads, payloads, payloads, st.data())
def test_a_flipped_bit_is_never_accepted_and_costs_two_frames_at_most(
    before: bytes, hit: bytes, after: bytes, data: st.DataObject
) -> None:
    damaged = bytearray(frame(hit))
    bit = data.draw(st.integers(0, 8 * len(damaged) - 1))
    damaged[bit // 8] ^= 1 << bit % 8
    deframer = Deframer()
    got = deframer.feed(frame(before) + bytes(damaged) + frame(after) + frame(before))
    # Where the flip took the boundary, the next frame is lost with it; nothing else is.
    assert got in ([before, after, before], [before, before])
    assert deframer.faults.total() >= 1


@given(st.binary(max_size=200), payloads)
def test_after_garbage_the_next_frame_but_one_is_whole(garbage: bytes, payload: bytes) -> None:
    deframer = Deframer()
    got = deframer.feed(garbage + frame(payload) + frame(payload))
    assert got[-1:] == [payload]
    assert len(got) <= 2


@pytest.mark.parametrize("fill", [b"\0", b"\x01", b"\xff"])
def test_the_longest_payload_passes(fill: bytes) -> None:
    assert Deframer().feed(frame(fill * MAX_PAYLOAD)) == [fill * MAX_PAYLOAD]


@given(hellos)
def test_hello_round_trips(hello: Hello) -> None:
    assert decode(encode_hello(hello)) == hello


@settings(max_examples=25)
@given(datas())
def test_data_round_trips(data: Data) -> None:
    again = decode(encode_data(data))
    assert isinstance(again, Data)
    assert (again.boot, again.sequence) == (data.boot, data.sequence)
    for name in ("ticks", "gyro", "accel", "temperature_c"):
        np.testing.assert_array_equal(getattr(again, name), getattr(data, name))


@settings(max_examples=50)
@given(packets, st.data())
def test_a_mutated_packet_is_bad_or_decodes(packet: bytes, data: st.DataObject) -> None:
    mutant = bytearray(packet)
    for _ in range(data.draw(st.integers(1, 6))):
        mutant[data.draw(st.integers(0, len(mutant) - 1))] = data.draw(st.integers(0, 255))
    _decodes_or_is_bad(bytes(mutant) + data.draw(st.binary(max_size=40)))


@pytest.mark.parametrize(
    ("payload", "label"),
    [
        (encode_identify(), "packet_unknown_kind"),
        (b"\x01\x01", "packet_length"),
        (b"\x02\x00" + bytes(12), "packet_length"),
        (b"\x02\x19" + bytes(12 + 25 * 32), "packet_length"),
        (b"\x01\x02" + bytes(60), "packet_version"),
        (b"\x01\x01" + struct.pack("<QdddB", 1, 1e-6, float("nan"), 1.0, 0) + b"m\0f", "packet_content"),
        (b"\x01\x01" + struct.pack("<QdddB", 1, 1e-6, 104.0, 1.0, 0) + b"no end of the model", "packet_content"),
        (b"\x01\x01" + struct.pack("<QdddB", 1, 1e-6, 104.0, 1.0, 0) + b"m\x1b[2J\0f", "packet_content"),
    ],
)
def test_a_bad_packet_says_why(payload: bytes, label: str) -> None:
    with pytest.raises(BadPacket) as bad:
        decode(payload)
    assert bad.value.label == label


def _decodes_or_is_bad(payload: bytes) -> None:
    with suppress(BadPacket):
        decode(payload)
