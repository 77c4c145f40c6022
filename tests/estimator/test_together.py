"""A round read and written all at once says what the door and the codec say, to the bit, or leaves it to them."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.wire import codec, keys
from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import MAX_SEQUENCE, Stencil
from bridge.wire.checks import MAX_TIME_NS
from bridge.wire.messages import Quality, SampleBatch
from estimator.block import sample_time_ns, temperature_at
from estimator.correction import Correction
from estimator.course import PLAIN_S, Point
from estimator.gyro import GyroModel
from estimator.service.published import Encoder
from estimator.service.senders import Sender, Senders
from estimator.service.together import Come, Round

KEY = keys.build("w", "raw", bridge="b", device="d")
SENDER = Sender.of("d", "b")
NOBODY = -1


def batch_of(rng: np.random.Generator, n: int, *, accel: bool = True, celsius: bool = False) -> SampleBatch:
    return SampleBatch(
        device="d",
        boot=int(rng.integers(1, 2**64, dtype=np.uint64)),
        sequence=int(2 ** rng.uniform(0, 61)),
        receive_time_ns=int(rng.integers(1, 2**61)),
        start_time_ns=int(rng.integers(1, 2**61)),
        tick_period_s=float(rng.choice([1e-6, 1.0, 0.01 / 3])),
        clock_rate=float(rng.choice([1.0, 1.00001234])),
        ticks=np.cumsum(rng.integers(1, 1000, n), dtype=np.uint64) + rng.integers(2**50, dtype=np.uint64),
        gyro=rng.normal(0, 9, (n, 3)).astype(np.float32),
        accel=rng.normal(0, 9, (n, 3)).astype(np.float32) if accel else None,
        temperature_c=rng.normal(30, 5, n).astype(np.float32) if celsius else None,
        flags=np.zeros(n, np.uint32),
        bridge="b",
    )


def table(*of: Sender) -> Senders:
    senders = Senders(len(of))
    for place, sender in enumerate(of):
        senders.admit(place, sender)
    return senders


def round_of(payloads: list[bytes]) -> Round:
    return Round(payloads, [0] * len(payloads), table(SENDER), goes_on=False)


def each(whole: Round, payloads: list[bytes]) -> list[Come | None]:
    return [whole.come(n, n + 1, SENDER) if whole.fit(n) else None for n in range(len(payloads))]


def came_of(payloads: list[bytes]) -> list[Come | None]:
    return each(round_of(payloads), payloads)


def assert_as_the_door_says(come: Come, payload: bytes) -> None:
    decoded = codec.decode_samples(KEY, payload)
    batch, first = come.sent.where(0)
    assert first == 0
    for field in fields(SampleBatch):
        mine, theirs = getattr(batch, field.name), getattr(decoded, field.name)
        np.testing.assert_array_equal(mine, theirs)
        assert type(mine) is type(theirs)
    missing = np.full_like(decoded.gyro, np.nan)
    sides = decoded.device_time[:, None], decoded.gyro, missing if decoded.accel is None else decoded.accel
    np.testing.assert_array_equal(come.rows, np.hstack(sides))
    assert (come.sent.boot, come.sent.sequence, come.earliest_ns) == (batch.boot, batch.sequence, batch.receive_time_ns)
    assert (come.following, come.received_ns) == (batch.sequence + len(batch), batch.receive_time_ns)
    assert come.last_s == decoded.device_time[-1]


def test_what_a_bridge_writes_is_read() -> None:
    rng = np.random.default_rng(0)
    payloads = [
        codec.encode_samples(batch_of(rng, n, accel=accel, celsius=celsius))
        for n in (1, 2, 10, 50, codec.MAX_SAMPLES)
        for accel in (True, False)
        for celsius in (True, False)
    ]
    for come, payload in zip(came_of(payloads), payloads, strict=True):
        assert come is not None
        assert_as_the_door_says(come, payload)


def test_nobodys_and_anothers_messages_are_left_to_the_door() -> None:
    payload = codec.encode_samples(batch_of(np.random.default_rng(1), 10))
    other = codec.encode_samples(replace(batch_of(np.random.default_rng(1), 10), device="e"))
    payloads, places = [payload, payload, other, payload, b"", payload], [0, NOBODY, 0, 1, 0, 0]
    found = Round(payloads, places, table(SENDER, Sender.of("dd", "b")), goes_on=True)
    assert [found.fit(n) for n in range(6)] == [True, False, False, False, False, True]
    assert found.others == list(range(6)), "where they are is not known"
    assert Round([], [], table(SENDER), goes_on=True).others == []


@pytest.mark.parametrize(
    "odd",
    [
        {"flags": np.full(10, 2, np.uint32)},
        {"boot": 0},
        {"sequence": 0},
        {"sequence": MAX_SEQUENCE},
        {"receive_time_ns": 0},
        {"receive_time_ns": -5},
        {"start_time_ns": MAX_TIME_NS},
        {"tick_period_s": 0.0},
        {"tick_period_s": 1e-10},
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
    ],
    ids=lambda odd: next(iter(odd)),
)
def test_what_is_unfit_or_odd_is_left_to_the_door_and_its_neighbours_are_not(odd: dict[str, Any]) -> None:
    rng = np.random.default_rng(2)
    payloads = [codec.encode_samples(batch_of(rng, 10)) for _ in range(3)]
    payloads[1] = codec.encode_samples(replace(batch_of(rng, 10), **odd))
    before, unfit, after = came_of(payloads)
    assert unfit is None
    assert before is not None
    assert_as_the_door_says(before, payloads[0])
    assert after is not None
    assert_as_the_door_says(after, payloads[2])


def test_more_samples_than_the_door_takes_are_left_to_it() -> None:
    payload = codec.encode_samples(batch_of(np.random.default_rng(7), codec.MAX_SAMPLES + 1, accel=False))
    assert came_of([payload]) == [None]


@pytest.mark.parametrize("column", ["ticks", "gyro", "accel", "temperature_c"])
def test_a_column_with_a_part_of_a_number_is_left_to_the_door(column: str) -> None:
    message = columns.SampleBatch.FromString(codec.encode_samples(batch_of(np.random.default_rng(8), 3, celsius=True)))
    setattr(message, column, getattr(message, column) + b"\0")
    assert came_of([message.SerializeToString()]) == [None]


def test_a_message_cut_short_anywhere_is_left_to_the_door_or_is_whole_without_the_rest() -> None:
    whole = codec.encode_samples(batch_of(np.random.default_rng(9), 1, celsius=True))
    read_all_the_same = 0
    for end in range(len(whole)):
        (come,) = came_of([whole[:end]])
        if come is not None:
            read_all_the_same += 1
            assert_as_the_door_says(come, whole[:end])
    assert read_all_the_same == 2  # without the temperature, and without the accelerometer too


@given(st.data())
def test_nothing_is_read_that_the_door_refuses_or_reads_otherwise(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 9)))
    whole = codec.encode_samples(batch_of(rng, int(rng.integers(1, 4)), celsius=bool(rng.integers(2))))
    payload = bytearray(whole)
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
    (come,) = came_of([bytes(payload)])
    if come is not None and come.last_s < come.rows[0, 0] + PLAIN_S:  # for longer ones see the session
        assert_as_the_door_says(come, bytes(payload))


def test_fields_twice_or_in_another_order_are_left_to_the_door() -> None:
    whole = columns.SampleBatch.FromString(codec.encode_samples(batch_of(np.random.default_rng(3), 3, celsius=True)))
    parts = []
    for field, value in whole.ListFields():
        one = columns.SampleBatch()
        setattr(one, field.name, value)
        parts.append(one.SerializeToString())
    assert came_of([b"".join(parts)])[0] is not None
    for n in range(len(parts)):
        without = parts[:n] + parts[n + 1 :]
        for at in range(len(parts)):
            payload = b"".join([*without[:at], parts[n], *without[at:]])
            assert (came_of([payload])[0] is not None) == (at == n)
            assert came_of([b"".join([*parts[:at], parts[n], *parts[at:]])])[0] is None
        (come,) = came_of([b"".join(without)])
        if come is None:  # what may be missing is not missed
            assert n < len(parts) - 2
        else:
            assert_as_the_door_says(come, b"".join(without))


def test_a_number_in_more_bytes_than_it_needs_is_read_or_left_to_the_door() -> None:
    payload = codec.encode_samples(replace(batch_of(np.random.default_rng(4), 3), sequence=5))
    at = payload.index(b"\x20\x05") + 1
    for n in range(1, 12):
        longer = payload[:at] + b"\x85" + b"\x80" * (n - 1) + b"\x00" + payload[at + 1 :]
        (come,) = came_of([longer])
        if come is not None:
            assert_as_the_door_says(come, longer)
        else:
            assert n > 8


def correction_of(rng: np.random.Generator, scale: float = 1.0) -> Correction:
    matrix, vectors = scale * np.eye(3) + rng.normal(0, 0.1, (3, 3)), rng.normal(0, 1, (5, 3))
    return Correction(
        GyroModel(matrix, vectors[0], *np.abs(vectors[1:4])), np.abs(vectors[4]), Quality.GOOD, "it", 2e-4
    )


def test_it_is_corrected_and_encoded_as_a_batch_by_itself() -> None:
    rng = np.random.default_rng(5)
    batches = [replace(batch_of(rng, int(rng.integers(2, 60))), tick_period_s=1e-6) for _ in range(200)]
    batches[0] = replace(batches[0], gyro=np.full_like(batches[0].gyro, -0.0))
    payloads = [codec.encode_samples(batch) for batch in batches]
    whole = round_of(payloads)
    parts = []
    for batch, come in zip(batches, each(whole, payloads), strict=True):
        assert come is not None
        correction, cut = correction_of(rng), int(rng.integers(1, len(batch)))
        parts += [(come, correction, 0, cut), (come, correction, cut, len(batch))]
    for samples, (come, correction, first, last) in zip(whole.corrected(parts), parts, strict=True):
        alone = correction.apply(come.sent.where(0)[0], first, last)
        assert Encoder(7).stencil("d", come.sent.boot, correction).enclose(samples) == Encoder(7).encode(alone)
        assert Stencil(alone, 7).enclose(samples) == codec.encode_corrected(replace(alone, epoch=7))
        assert Stencil(alone, 0).under(7).enclose(samples) == codec.encode_corrected(replace(alone, epoch=7))


@pytest.mark.parametrize("scale", [1e3, np.nan, 1e300])
def test_a_rate_beyond_the_wire_is_not_encoded_and_its_neighbours_are(scale: float) -> None:
    rng = np.random.default_rng(6)
    payloads = [codec.encode_samples(batch_of(rng, 10)) for _ in range(3)]
    whole = round_of(payloads)
    corrections = [correction_of(rng), correction_of(rng, scale), correction_of(rng)]
    parts = [
        (come, one, 0, 10) for come, one in zip(each(whole, payloads), corrections, strict=True) if come is not None
    ]
    alone = [whole.corrected([part])[0] for part in parts]
    assert whole.corrected(parts) == alone
    assert [bool(samples) for samples in alone] == [True, False, True]


def going(n: int, first: int = 5) -> list[SampleBatch]:
    """Batches of ten that follow each other."""
    one = replace(batch_of(np.random.default_rng(11), 10), tick_period_s=1e-3, clock_rate=1.0)
    ticks = np.arange(1000, 1010, dtype=np.uint64)
    return [replace(one, sequence=first + 10 * i, ticks=ticks + np.uint64(10 * i)) for i in range(n)]


def standing(batch: SampleBatch, shift: float = 0.0) -> tuple[Senders, Correction]:
    """The second of two senders is where this batch comes next, in a block of its own that ends at 9 s."""
    senders, correction = table(Sender.of("e", "b"), SENDER), correction_of(np.random.default_rng(12))
    assert senders.corrects(1, correction, Encoder(7).stencil("d", batch.boot, correction))
    senders.stands(1, batch.boot, batch.sequence, Point(batch.device_time[0] - 1e-3 + shift, shift, 9.0))
    return senders, correction


@pytest.mark.parametrize("shift", [0.0, 2.5])
def test_what_goes_on_is_corrected_ahead_as_by_itself_round_after_round(shift: float) -> None:
    batches = going(6)
    senders, correction = standing(batches[0], shift)
    for pair in (batches[:2], batches[2:4], batches[4:]):
        whole = Round([codec.encode_samples(batch) for batch in pair], [1, 1], senders, goes_on=True)
        assert whole.others == []
        assert whole.samples(whole.ahead) == 20
        assert whole.corrected_ahead(whole.ahead) == [Encoder(7).encode(correction.apply(b, 0, 10)) for b in pair]


@pytest.mark.parametrize(
    "odd",
    [
        {"boot": 3},
        {"sequence": 6},
        {"sequence": 4},
        {"ticks": np.arange(999, 1009, dtype=np.uint64)},
        {"ticks": np.arange(8991, 9001, dtype=np.uint64)},
        {"device": "e"},
        {"flags": np.full(10, 2, np.uint32)},
    ],
    ids=["boot", "hole", "again", "time", "block", "device", "flags"],
)
def test_what_does_not_go_on_and_all_behind_it_take_another_way(odd: dict[str, Any]) -> None:
    first, second = going(2)
    payloads = [codec.encode_samples(batch) for batch in (replace(first, **odd), first, second)]
    senders, _ = standing(first)
    assert Round(payloads, [1, 1, 1], senders, goes_on=True).others == [0, 1, 2]
    assert Round(payloads[1:], [1, 1], senders, goes_on=True).others == [0, 1], "and in the next round"
    senders, _ = standing(first)
    assert Round(payloads, [1, 1, 1], senders, goes_on=False).others == [0, 1, 2]
    assert Round(payloads[1:], [1, 1], senders, goes_on=True).others == [], "before it was only read"


def test_nothing_goes_on_from_a_sender_that_was_lost() -> None:
    (batch,) = going(1)
    senders, _ = standing(batch)
    senders.lose(1)
    assert Round([codec.encode_samples(batch)], [1], senders, goes_on=True).others == [0]


def test_a_rate_beyond_the_wire_is_not_said_ahead() -> None:
    first, second = going(2)
    senders, correction = standing(first)
    threefold = replace(correction, model=replace(correction.model, matrix=3 * np.eye(3)))
    assert senders.corrects(1, threefold, Encoder(7).stencil("d", first.boot, threefold))
    large = replace(first, gyro=np.full((10, 3), 999.0, np.float32))
    whole = Round([codec.encode_samples(batch) for batch in (large, second)], [1, 1], senders, goes_on=True)
    assert [bool(said) for said in whole.corrected_ahead(whole.ahead)] == [False, True]


def test_there_is_no_room_for_all_that_could_be_said_of_a_correction() -> None:
    senders, correction = standing(going(1)[0])
    wide = replace(correction, calibration="\N{OHM SIGN}" * 64)
    assert not senders.corrects(1, wide, Encoder(7).stencil("d", 1, wide))


@pytest.mark.parametrize("sizes", [[1], [3, 1, 10], [10] * 5])
@pytest.mark.parametrize("warm", [True, False])
def test_a_sample_of_a_stretch_is_found_in_the_batch_it_was_sent_with(sizes: list[int], *, warm: bool) -> None:
    rng = np.random.default_rng(13)
    first, *batches = [batch_of(rng, n, celsius=warm) for n in (2, *sizes)]
    payloads = [codec.encode_samples(first), *map(codec.encode_samples, batches)]
    sent = round_of(payloads).come(1, len(payloads), SENDER).sent
    assert (sent.boot, sent.sequence) == (batches[0].boot, batches[0].sequence)
    places = [(batch, i) for batch in batches for i in range(len(batch))]
    for index in [*range(len(places)), *reversed(range(len(places)))]:
        found, place = sent.where(index)
        batch, expected = places[index]
        assert (found.sequence, found.bridge, place) == (batch.sequence, "b", expected)
        assert sent.temperature(index) == temperature_at(batch, expected)
        assert sent.time_ns(index) == sample_time_ns(batch, expected)
        np.testing.assert_array_equal(found.gyro, batch.gyro)
