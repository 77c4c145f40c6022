"""What is encoded is decoded back; what is damaged, foreign or out of bounds is refused, nothing else escapes."""

import dataclasses
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.wire import codec, columns_pb2, keys, truerate_pb2
from bridge.wire.messages import (
    BiasRevision,
    BootCause,
    Calibration,
    Checkpoint,
    Command,
    CommandReply,
    CorrectedBatch,
    DeviceInfo,
    Holding,
    Move,
    Note,
    Owned,
    Quality,
    SampleBatch,
    SampleFlag,
    State,
    Status,
    Turn,
    Verdict,
    WindowBatch,
)
from bridge.wire.refusal import Reason, Refusal

RAW = keys.build("ward", "raw", bridge="b1", device="d1")
INFO = keys.build("ward", "info", bridge="b1", device="d1")
CORRECTED = keys.build("ward", "corrected", device="d1")
STATUS = keys.build("ward", "status", device="d1")
CALIBRATION = keys.build("ward", "calibration", device="d1")
REVISION = keys.build("ward", "revision", device="d1")
WINDOWED = keys.build("ward", "@windowed", device="d1")
NOTE = keys.build("ward", "note", device="d1")
RPC = keys.build("ward", "rpc", device="d1", verb="recalibrate")

CHECKPOINT = keys.build("ward", "checkpoint", device="d1")
OWN = keys.build("ward", "owned", estimator="e1")

NAN, INF = float("nan"), float("inf")
U64 = st.integers(0, 2**64 - 1)
TIME = st.integers(0, 2**62)
TEXT = st.text(st.characters(codec="utf-8").filter(str.isprintable), max_size=64)
#: so that the last sample of a dozen, too, has a time that can be said
BEGIN, PERIOD = st.integers(0, 2**61), st.floats(1e-9, 1e-3)
LABELS = st.dictionaries(TEXT, U64, max_size=5)


def within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, width=32)


def column(data: st.DataObject, limit: float, *shape: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    size = int(np.prod(shape))
    return np.array(data.draw(st.lists(within(limit), min_size=size, max_size=size)), np.float32).reshape(shape)


def ticks(data: st.DataObject) -> np.ndarray[Any, np.dtype[np.uint64]]:
    steps = data.draw(st.lists(st.integers(1, 2**20), min_size=1, max_size=12))
    return data.draw(st.integers(0, 2**62)) + np.cumsum(steps, dtype=np.uint64)


def flags(data: st.DataObject, n: int) -> np.ndarray[Any, np.dtype[np.uint32]]:
    return np.array(data.draw(st.lists(st.integers(0, 3), min_size=n, max_size=n)), np.uint32)


def samples(data: st.DataObject) -> SampleBatch:
    when = ticks(data)
    n = len(when)
    return SampleBatch(
        "d1", data.draw(U64), data.draw(TIME), data.draw(TIME), data.draw(BEGIN), data.draw(PERIOD),
        data.draw(st.floats(1e-4, 1e4)), when, column(data, 1000, n, 3),
        column(data, 10_000, n, 3) if data.draw(st.booleans()) else None,
        column(data, 500, n) if data.draw(st.booleans()) else None, flags(data, n), "b1",
    )  # fmt: skip


def corrected(data: st.DataObject) -> CorrectedBatch:
    when = ticks(data)
    n = len(when)
    return CorrectedBatch(
        "d1", data.draw(U64), data.draw(TIME), data.draw(BEGIN), data.draw(PERIOD),
        data.draw(st.floats(1e-4, 1e4)), when, column(data, 2000, n, 3), flags(data, n),
        data.draw(st.sampled_from(Quality)), abs(column(data, 9, 3)),
        abs(column(data, 9, 3)), abs(column(data, 9, 3)), column(data, 1000, 3), data.draw(TEXT), abs(column(data, 9, 3)),
        data.draw(TIME),
    )  # fmt: skip


INFOS = st.builds(
    DeviceInfo, st.just("d1"), st.just("b1"), U64, st.sampled_from(BootCause), TEXT, TEXT, TEXT, TEXT,
    st.floats(0, 1e6), st.floats(0, 1e9), st.floats(0, 1000), st.booleans(), st.booleans(), TIME, U64, LABELS, LABELS,
    TEXT, st.floats(0, 100), st.booleans(), st.dictionaries(TEXT, TEXT, max_size=16), st.booleans(),
)  # fmt: skip
THREE = st.tuples(*[st.floats(-10, 10)] * 3)
STDS = st.tuples(*[st.floats(0, 10)] * 3)
STATUSES = st.builds(
    Status, st.just("d1"), U64, TIME, st.sampled_from(State), st.sampled_from(Quality), TEXT, st.floats(0, 1),
    st.lists(st.integers(0, 2), max_size=3).map(tuple), THREE, STDS, THREE, TEXT, TIME, st.floats(0, 1e9),
    st.floats(-100, 100), st.floats(0, 1e6), U64, U64, LABELS, LABELS, st.just("b1"), st.just(("b2",)), TIME,
)  # fmt: skip
TURNS = st.builds(Turn, st.integers(0, 2), st.floats(-9, 9), st.floats(0, 9), st.floats(0, 99))


PARAMETERS = ("bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z")


@st.composite
def calibrations(draw: st.DrawFn, *, in_use: bool = False) -> Calibration:
    names = (PARAMETERS if in_use else ()) + tuple(draw(st.lists(TEXT, max_size=4)))
    size = len(names)
    verdict = Verdict.ACCEPTED if in_use else draw(st.sampled_from(Verdict))
    return Calibration(
        "d1", draw(U64), draw(TEXT), draw(TIME), draw(TEXT), verdict, draw(TEXT),
        np.array(draw(st.lists(st.floats(-2, 2), min_size=9, max_size=9))).reshape(3, 3), np.array(draw(THREE)), names,
        np.array(draw(st.lists(st.floats(-2, 2), min_size=size**2, max_size=size**2)), float).reshape(size, size),
        tuple(draw(st.lists(TURNS, max_size=4))), np.array(draw(STDS)), draw(TEXT), draw(TEXT),
        draw(st.floats(0, 1000)), draw(st.floats(0, 1e6)), draw(st.floats(-100, 100)), draw(TEXT), draw(TIME),
    )  # fmt: skip


HOLDINGS = st.builds(Holding, st.sampled_from(["d1", "bed-2_chest"]), TIME, U64, TIME, st.booleans())
OWNED = st.builds(
    Owned, st.just("e1"), TIME, TIME, st.floats(0, 100), st.lists(HOLDINGS, max_size=4).map(tuple),
    st.lists(st.builds(Move, TIME, st.integers(0, 9), st.integers(0, 9), TEXT), max_size=8).map(tuple),
    st.integers(0, 3), st.integers(4, 64),
)  # fmt: skip


@st.composite
def checkpoints(draw: st.DrawFn) -> Checkpoint:
    n = draw(st.sampled_from([0, 6]))
    root = np.array(draw(st.lists(st.floats(-2, 2), min_size=n * n, max_size=n * n)), float).reshape(n, n)
    return Checkpoint(
        "d1", draw(U64), draw(TIME), draw(TIME), np.array(draw(st.lists(st.floats(-9, 9), min_size=n, max_size=n)), float),
        root @ root.T, draw(st.floats(-1e9, 1e9)), draw(st.floats(-100, 100)), draw(st.sampled_from([-INF, 0.0, 17.5])),
        draw(st.booleans()), draw(TEXT), draw(TEXT), draw(st.none() | calibrations(in_use=True)),
        draw(st.sampled_from(["", "b1"])), draw(st.sampled_from([(), (0,), (2, 1)])),
        tuple(draw(st.lists(st.tuples(TEXT, st.builds(CommandReply, TEXT, st.booleans(), TEXT)), max_size=8))),
        draw(st.floats(-500, 500)),
    )  # fmt: skip


def rising(data: st.DataObject, n: int, high: int) -> list[int]:
    return sorted(data.draw(st.lists(st.integers(0, high), min_size=n, max_size=n, unique=True)))


def revision(data: st.DataObject) -> BiasRevision:
    n = data.draw(st.integers(2, 12))
    return BiasRevision(
        "d1", data.draw(U64), data.draw(TEXT), data.draw(TIME), column(data, 10, 3, 3).astype(float),
        np.array(rising(data, n, 2**62), np.uint64), np.array(rising(data, n, 2**62), np.int64),
        column(data, 1000, n, 3), abs(column(data, 9, n, 3)), data.draw(TEXT),
    )  # fmt: skip


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            assert a.tobytes() == b.tobytes(), field.name
        elif dataclasses.is_dataclass(a):
            assert_same(a, b)
        else:
            assert a == b, field.name


@given(st.data())
def test_samples_round_trip(data: st.DataObject) -> None:
    batch = samples(data)
    assert_same(codec.decode_samples(RAW, codec.encode_samples(batch)), batch)


@given(st.data())
def test_corrected_round_trip(data: st.DataObject) -> None:
    batch = corrected(data)
    assert_same(codec.decode_corrected(CORRECTED, codec.encode_corrected(batch)), batch)


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


@given(INFOS)
def test_info_round_trip(info: DeviceInfo) -> None:
    assert codec.decode_info(INFO, codec.encode_info(info)) == info


@given(STATUSES)
def test_status_round_trip(status: Status) -> None:
    assert codec.decode_status(STATUS, codec.encode_status(status)) == status


@given(calibrations())
def test_calibration_round_trip(calibration: Calibration) -> None:
    assert_same(codec.decode_calibration(CALIBRATION, codec.encode_calibration(calibration)), calibration)


@given(st.data())
def test_revision_round_trip(data: st.DataObject) -> None:
    one = revision(data)
    assert_same(codec.decode_revision(REVISION, codec.encode_revision(one)), one)


@given(OWNED)
def test_owned_round_trip(owned: Owned) -> None:
    assert codec.decode_owned(OWN, codec.encode_owned(owned)) == owned


@given(checkpoints())
def test_checkpoint_round_trip(checkpoint: Checkpoint) -> None:
    assert_same(codec.decode_checkpoint(CHECKPOINT, codec.encode_checkpoint(checkpoint)), checkpoint)


@given(st.builds(Note, st.just("d1"), U64, TIME, TEXT, TEXT))
def test_note_round_trip(note: Note) -> None:
    assert codec.decode_note(NOTE, codec.encode_note(note)) == note


@given(st.builds(Command, TEXT.filter(bool), TEXT, TEXT), st.builds(CommandReply, TEXT, st.booleans(), TEXT))
def test_command_and_reply_round_trip(command: Command, reply: CommandReply) -> None:
    assert codec.decode_command(RPC, codec.encode_command(command)) == command
    assert codec.decode_reply(codec.encode_reply(reply)) == reply
    assert codec.encode_reply(reply)


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


def plain(n: int = 4, **changes: Any) -> SampleBatch:
    batch = SampleBatch(
        "d1", 7, 100, 10**18, 10**18, 1e-6, 1.0, np.arange(n, dtype=np.uint64) * 10_000, np.ones((n, 3), np.float32),
        np.ones((n, 3), np.float32), np.full(n, 30, np.float32), np.zeros(n, np.uint32),
        "b1",
    )  # fmt: skip
    return dataclasses.replace(batch, **changes)


STILL = Status(
    "d1", 7, 1, State.TRACKING, Quality.GOOD, "fine", 1.0, (0, 1, 2), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0),
    "c1", 1, 0.0, float("nan"), 100.0, 1, 1, {"a": 1}, {}, "b1", ("b2",),
)  # fmt: skip
CAL = Calibration(
    "d1", 7, "c1", 1, "closure", Verdict.ACCEPTED, "", np.eye(3), np.zeros(3), PARAMETERS, np.eye(6),
    (Turn(0, 6.28, 0.01, 5),), np.ones(3), "m", "f", 4.3, 100.0, float("nan"), "anna",
)  # fmt: skip
SURE = DeviceInfo(
    "d1", "b1", 7, BootCause.POWER_UP, "m", "f", "native", "/dev/x", 100, 99.9, 4.3, True, True, 1, 5, {"a": 1},
    battery_percent=71.5, charging=True, notices={"auto bias": "is on; it fights our own"},
)  # fmt: skip
FIXED = CorrectedBatch(
    "d1", 7, 1, 1, 1e-6, 1.0, np.arange(3, dtype=np.uint64), np.ones((3, 3), np.float32), np.zeros(3, np.uint32),
    Quality.GOOD, np.ones(3, np.float32), np.ones(3, np.float32), np.ones(3, np.float32), np.ones(3, np.float32), "c1",
    np.ones(3, np.float32),
)  # fmt: skip
REVISED = BiasRevision(
    "d1", 7, "c1", 9, np.eye(3), np.array([3, 103, 203], np.uint64), np.array([10**18, 10**18 + 1, 10**18 + 9], np.int64),
    np.full((3, 3), 0.01, np.float32), np.full((3, 3), 1e-4, np.float32), "at rest again after 95 s",
)  # fmt: skip
HALF, ONE = np.full((2, 3), 0.5, np.float32), np.ones(3, np.float32)
SEEN = WindowBatch(
    "d1", 7, 0.1, np.array([3, 13], np.uint64), np.array([10**18, 10**18 + 9], np.int64), np.array([4, 10], np.uint32),
    np.array([0, 2], np.uint32), HALF, HALF, HALF, HALF, HALF, HALF, HALF, HALF, Quality.GOOD, ONE, ONE, ONE, ONE, ONE, "c1",
)  # fmt: skip
DOORS: dict[str, tuple[Callable[[bytes], Any], bytes]] = {
    "samples": (lambda payload: codec.decode_samples(RAW, payload), codec.encode_samples(plain())),
    "corrected": (lambda payload: codec.decode_corrected(CORRECTED, payload), codec.encode_corrected(FIXED)),
    "info": (lambda payload: codec.decode_info(INFO, payload), codec.encode_info(SURE)),
    "status": (lambda payload: codec.decode_status(STATUS, payload), codec.encode_status(STILL)),
    "calibration": (lambda payload: codec.decode_calibration(CALIBRATION, payload), codec.encode_calibration(CAL)),
    "revision": (lambda payload: codec.decode_revision(REVISION, payload), codec.encode_revision(REVISED)),
    "windows": (lambda payload: codec.decode_windows(WINDOWED, payload), codec.encode_windows(SEEN)),
    "note": (
        lambda payload: codec.decode_note(NOTE, payload),
        codec.encode_note(Note("d1", 7, 10**18, "anna", "sat up")),
    ),
    "owned": (
        lambda payload: codec.decode_owned(OWN, payload),
        codec.encode_owned(Owned("e1", 9, 7, 0.5, (Holding("d1", 7, 3, 9),), (Move(1, 2, 3, "e2 is gone"),))),
    ),
    "checkpoint": (
        lambda payload: codec.decode_checkpoint(CHECKPOINT, payload),
        codec.encode_checkpoint(Checkpoint("d1", 7, 1, 9, np.ones(6), np.eye(6), 1.0, NAN, -INF, True, "a", "b", CAL)),
    ),
    "command": (lambda payload: codec.decode_command(RPC, payload), codec.encode_command(Command("r1", "anna", "why"))),
    "reply": (codec.decode_reply, codec.encode_reply(CommandReply("r1", True, "done"))),
}


@pytest.mark.parametrize("kind", DOORS)
def test_every_truncation_is_whole_or_refused(kind: str) -> None:
    door, payload = DOORS[kind]
    door(payload)
    for end in range(len(payload)):
        try_door(door, payload[:end])


def try_door(door: Callable[[bytes], Any], payload: bytes) -> None:
    try:
        door(payload)
    except Refusal as refusal:
        said = refusal
    else:
        return
    assert isinstance(said.reason, Reason)
    assert len(said.detail) < 1000


@pytest.mark.parametrize("kind", DOORS)
@given(data=st.data())
def test_whatever_is_mutated_only_a_refusal_comes_out(kind: str, data: st.DataObject) -> None:
    door, payload = DOORS[kind]
    mutated = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(mutated) - 1))
        mutated[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=5))
        mutated = mutated or bytearray(b"\0")
    try_door(door, bytes(mutated))


@pytest.mark.parametrize("kind", DOORS)
@given(payload=st.binary(max_size=200))
def test_noise_is_refused(kind: str, payload: bytes) -> None:
    try_door(DOORS[kind][0], payload)


def refused(payload: bytes, key: str = RAW, decode: Callable[[str, bytes], Any] = codec.decode_samples) -> Reason:
    with pytest.raises(Refusal) as caught:
        decode(key, payload)
    return caught.value.reason


WRONG_WINDOWS: list[tuple[dict[str, Any], Reason]] = [
    ({"device": "d2"}, Reason.FOREIGN_ID),
    ({"sequences": np.array([13, 3], np.uint64)}, Reason.RANGE),
    ({"sequences": np.array([3, 2**62 + 1], np.uint64)}, Reason.RANGE),
    ({"times_ns": np.array([9, 9], np.int64)}, Reason.RANGE),
    ({"times_ns": np.array([-9, 9], np.int64)}, Reason.RANGE),
    ({"times_ns": np.array([9], np.int64)}, Reason.LENGTH),
    ({"samples": np.array([0, 1], np.uint32)}, Reason.RANGE),
    ({"samples": np.array([1], np.uint32)}, Reason.LENGTH),
    ({"flags": np.array([0, 64], np.uint32)}, Reason.RANGE),
    ({"window_s": 0.0}, Reason.RANGE),
    ({"rate_std": np.full((2, 3), -1, np.float32)}, Reason.RANGE),
    ({"reading_std": np.full((2, 3), np.nan, np.float32)}, Reason.NON_FINITE),
    ({"rate_max": np.full((2, 3), 2001, np.float32)}, Reason.RANGE),
    ({"reading_mean": np.full((3, 3), 1, np.float32)}, Reason.LENGTH),
    ({"bias_std": np.full(3, -1, np.float32)}, Reason.RANGE),
    ({"bias": np.full(3, 1001, np.float32)}, Reason.RANGE),
    ({"calibration": "x" * 65}, Reason.LENGTH),
    ({"quality": 9}, Reason.RANGE),
    (
        {"sequences": np.arange(65, dtype=np.uint64), "times_ns": np.arange(65), "samples": np.ones(65, np.uint32)},
        Reason.LENGTH,
    ),
]


@pytest.mark.parametrize(("changes", "reason"), WRONG_WINDOWS)
def test_windows_against_the_rules_are_refused(changes: dict[str, Any], reason: Reason) -> None:
    payload = codec.encode_windows(dataclasses.replace(SEEN, **changes))
    if len(changes.get("calibration", "")) > 64:
        payload = _unclean(payload)
    assert refused(payload, WINDOWED, codec.decode_windows) is reason


def _unclean(payload: bytes) -> bytes:
    message = truerate_pb2.WindowBatch.FromString(payload)
    message.calibration = "x" * 65
    return bytes(message.SerializeToString())


SIGNALLING = np.frombuffer(struct.pack("<12I", *[0x7FA00000] * 12), "<f4").reshape(4, 3)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"device": "d2"}, Reason.FOREIGN_ID),
        ({"device": "*"}, Reason.FOREIGN_ID),
        ({"gyro": np.full((4, 3), NAN, np.float32)}, Reason.NON_FINITE),
        ({"gyro": SIGNALLING}, Reason.NON_FINITE),
        ({"gyro": np.full((4, 3), -INF, np.float32)}, Reason.NON_FINITE),
        ({"gyro": np.full((4, 3), -1001, np.float32)}, Reason.RANGE),
        ({"gyro": np.ones((3, 3), np.float32)}, Reason.LENGTH),
        ({"accel": np.full((4, 3), NAN, np.float32)}, Reason.NON_FINITE),
        ({"accel": np.ones((5, 3), np.float32)}, Reason.LENGTH),
        ({"temperature_c": np.ones(3, np.float32)}, Reason.LENGTH),
        ({"temperature_c": np.full(4, 501, np.float32)}, Reason.RANGE),
        ({"flags": np.array([1, 0, 0], np.uint32)}, Reason.LENGTH),
        ({"flags": np.array([1, 0, 0, 32], np.uint32)}, Reason.RANGE),
        ({"ticks": np.array([], np.uint64)}, Reason.LENGTH),
        ({"ticks": np.array([1, 2, 2, 3], np.uint64)}, Reason.RANGE),
        ({"ticks": np.array([4, 3, 2, 1], np.uint64)}, Reason.RANGE),
        ({"ticks": np.array([1, 2, 3, 2**63], np.uint64)}, Reason.RANGE),
        ({"tick_period_s": 0.0}, Reason.RANGE),
        ({"tick_period_s": -1e-6}, Reason.RANGE),
        ({"tick_period_s": NAN}, Reason.NON_FINITE),
        ({"clock_rate": 0.0}, Reason.RANGE),
        ({"clock_rate": INF}, Reason.NON_FINITE),
        ({"receive_time_ns": -1}, Reason.RANGE),
        ({"start_time_ns": 2**62 + 1}, Reason.RANGE),
        ({"start_time_ns": 2**62}, Reason.RANGE),
        ({"ticks": np.array([1, 2, 3, 2**63 - 1], np.uint64)}, Reason.RANGE),
        ({"ticks": np.arange(4, dtype=np.uint64) * 10**12, "clock_rate": 1e4}, Reason.RANGE),
        ({"sequence": 2**64 - 1}, Reason.RANGE),
    ],
    ids=str,
)
def test_samples_out_of_bounds_are_refused_with_their_reason(changes: dict[str, Any], reason: Reason) -> None:
    assert refused(codec.encode_samples(plain(**changes))) is reason


def test_too_much_is_refused_before_it_is_parsed() -> None:
    assert refused(b"\0" * (codec.MAX_PAYLOAD + 1)) is Reason.TOO_LARGE
    most = plain(codec.MAX_SAMPLES, flags=np.ones(codec.MAX_SAMPLES, np.uint32))
    assert len(codec.decode_samples(RAW, codec.encode_samples(most))) == codec.MAX_SAMPLES
    assert refused(codec.encode_samples(plain(codec.MAX_SAMPLES + 1))) is Reason.LENGTH


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"device": "d2"}, Reason.FOREIGN_ID),
        ({"sequences": np.array([3, 103], np.uint64)}, Reason.LENGTH),
        ({"times_ns": np.array([1, 2], np.int64)}, Reason.LENGTH),
        ({"bias": np.zeros((2, 3), np.float32)}, Reason.LENGTH),
        ({"bias_std": np.zeros((3, 2), np.float32)}, Reason.LENGTH),
        ({"matrix": np.eye(2)}, Reason.LENGTH),
        ({"sequences": np.array([3, 3, 203], np.uint64)}, Reason.RANGE),
        ({"sequences": np.array([3, 203, 103], np.uint64)}, Reason.RANGE),
        ({"sequences": np.array([3, 103, 2**62 + 1], np.uint64)}, Reason.RANGE),
        ({"times_ns": np.array([1, 2, 2], np.int64)}, Reason.RANGE),
        ({"times_ns": np.array([-1, 2, 3], np.int64)}, Reason.RANGE),
        ({"times_ns": np.array([1, 2, 2**62 + 1], np.int64)}, Reason.RANGE),
        ({"bias": np.full((3, 3), NAN, np.float32)}, Reason.NON_FINITE),
        ({"bias": np.full((3, 3), -1001, np.float32)}, Reason.RANGE),
        ({"bias_std": np.full((3, 3), INF, np.float32)}, Reason.NON_FINITE),
        ({"bias_std": np.full((3, 3), -1, np.float32)}, Reason.RANGE),
        ({"matrix": np.full((3, 3), NAN)}, Reason.NON_FINITE),
        ({"matrix": np.full((3, 3), 11.0)}, Reason.RANGE),
        ({"time_ns": -1}, Reason.RANGE),
    ],
    ids=str,
)
def test_a_revision_out_of_bounds_is_refused_with_its_reason(changes: dict[str, Any], reason: Reason) -> None:
    payload = codec.encode_revision(dataclasses.replace(REVISED, **changes))
    assert refused(payload, REVISION, codec.decode_revision) is reason


def points(n: int, bias: float = 0.01) -> BiasRevision:
    """A revision of n points whose texts are as long as they may be."""
    return dataclasses.replace(
        REVISED, boot=2**64 - 1, calibration="😀" * 64, time_ns=2**62, reason="😀" * 500,
        sequences=np.arange(n, dtype=np.uint64), times_ns=np.arange(n), bias=np.full((n, 3), bias, np.float32),
        bias_std=np.ones((n, 3), np.float32),
    )  # fmt: skip


def test_a_revision_of_the_most_points_fits_and_the_refusal_of_one_is_short() -> None:
    assert len(codec.decode_revision(REVISION, codec.encode_revision(points(codec.MAX_POINTS)))) == codec.MAX_POINTS
    for n in (0, 1, codec.MAX_POINTS + 1):
        assert refused(codec.encode_revision(points(n)), REVISION, codec.decode_revision) is Reason.LENGTH
    for bad in (NAN, 2000.0):
        try_door(DOORS["revision"][0], codec.encode_revision(points(codec.MAX_POINTS, bad)))


def test_another_version_is_refused() -> None:
    message = columns_pb2.SampleBatch.FromString(codec.encode_samples(plain()))
    message.version = 2
    assert refused(message.SerializeToString()) is Reason.VERSION
    assert refused(b"") is Reason.VERSION


def test_a_field_of_the_future_is_passed_over() -> None:
    payload = codec.encode_samples(plain()) + b"\xa2\x06\x03abc"  # field 100
    assert_same(codec.decode_samples(RAW, payload), plain())


@pytest.mark.parametrize(
    ("key", "reason"),
    [("truerate/@v1/ward/raw/b1/*", Reason.WILDCARD_KEY), (CORRECTED, Reason.BAD_KEY), (RAW + "\n", Reason.BAD_ID)],
)
def test_a_wrong_key_is_refused(key: str, reason: Reason) -> None:
    assert refused(codec.encode_samples(plain()), key) is reason


def test_an_info_under_another_bridges_key_is_refused() -> None:
    key = keys.build("ward", "info", bridge="b2", device="d1")
    assert refused(codec.encode_info(SURE), key, codec.decode_info) is Reason.FOREIGN_ID


def test_a_device_that_cannot_be_read_is_told_of_with_boot_0_and_its_trouble() -> None:
    trouble = "/dev/x: missing; plug the device in"
    unread = DeviceInfo(
        "d1",
        "b1",
        0,
        BootCause.UNKNOWN,
        "",
        "",
        "native",
        "/dev/x",
        0,
        0,
        0,
        False,
        False,
        1,
        trouble=trouble,
        battery_percent=0.0,
    )
    assert codec.decode_info(INFO, codec.encode_info(unread)) == unread
    long = dataclasses.replace(SURE, trouble="x\n" * 999)
    assert len(codec.decode_info(INFO, codec.encode_info(long)).trouble) == 500


def test_a_command_must_be_known_and_carry_a_request_id() -> None:
    good = codec.encode_command(Command("r1", "anna", ""))
    assert refused(good, keys.build("ward", "rpc", device="d1", verb="explode"), codec.decode_command) is Reason.BAD_KEY
    assert refused(codec.encode_command(Command("", "a", "")), RPC, codec.decode_command) is Reason.LENGTH


def test_an_unknown_state_or_a_negative_deviation_is_refused() -> None:
    raw = truerate_pb2.Status.FromString(codec.encode_status(STILL))
    raw.state = 99  # type: ignore[assignment]
    assert refused(raw.SerializeToString(), STATUS, codec.decode_status) is Reason.RANGE
    bad = dataclasses.replace(FIXED, bias_std=np.array([1, -1, 1], np.float32))
    assert refused(codec.encode_corrected(bad), CORRECTED, codec.decode_corrected) is Reason.RANGE


def test_a_corrected_sample_too_has_a_time_that_can_be_said() -> None:
    bad = dataclasses.replace(FIXED, ticks=np.array([0, 1, 2**62], np.uint64))
    assert refused(codec.encode_corrected(bad), CORRECTED, codec.decode_corrected) is Reason.RANGE


def test_an_unknown_temperature_is_nan_in_status_and_calibration_only() -> None:
    assert np.isnan(codec.decode_status(*(STATUS, codec.encode_status(STILL))).temperature_c)
    assert np.isnan(codec.decode_calibration(CALIBRATION, codec.encode_calibration(CAL)).temperature_c)
    assert (
        refused(codec.encode_status(dataclasses.replace(STILL, rate_hz=NAN)), STATUS, codec.decode_status)
        is Reason.NON_FINITE
    )


def test_texts_go_out_printable_and_short_and_are_refused_otherwise() -> None:
    dirty = dataclasses.replace(SURE, model="x\ny\x1b[2J" + "z" * 99)
    assert codec.decode_info(INFO, codec.encode_info(dirty)).model == ("x y [2J" + "z" * 99)[:64]
    raw = truerate_pb2.DeviceInfo.FromString(codec.encode_info(SURE))
    raw.model = "two\nlines"
    assert refused(raw.SerializeToString(), INFO, codec.decode_info) is Reason.MALFORMED
    raw.model = "long" * 20
    assert refused(raw.SerializeToString(), INFO, codec.decode_info) is Reason.LENGTH


def test_a_decoded_batch_cannot_be_written_into() -> None:
    batch = codec.decode_samples(RAW, codec.encode_samples(plain()))
    with pytest.raises(ValueError, match="read-only"):
        batch.gyro[0, 0] = 1
    assert batch.flags.dtype == np.uint32
    assert SampleFlag(int(batch.flags[0])) is SampleFlag.OK


KEPT = Checkpoint("d1", 7, 1, 9, np.ones(6), np.eye(6), 1.0, 30.0, 0.0, False, "", "", CAL)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"device": "d2"}, Reason.FOREIGN_ID),
        ({"calibration": dataclasses.replace(CAL, device="d2")}, Reason.FOREIGN_ID),
        ({"calibration": dataclasses.replace(CAL, verdict=Verdict.REFUSED)}, Reason.RANGE),
        ({"calibration": dataclasses.replace(CAL, parameters=(), covariance=np.zeros((0, 0)))}, Reason.RANGE),
        ({"x": np.ones(5)}, Reason.LENGTH),
        ({"x": np.ones(0)}, Reason.LENGTH),
        ({"x": np.full(6, NAN)}, Reason.NON_FINITE),
        ({"covariance": -np.eye(6)}, Reason.RANGE),
        ({"covariance": np.tri(6)}, Reason.RANGE),
        ({"covariance": np.ones((6, 6)) - 0.1 * np.eye(6)}, Reason.RANGE),
        ({"covariance": np.eye(5)}, Reason.LENGTH),
        ({"epoch": 2**63}, Reason.RANGE),
        ({"powered_s": INF}, Reason.NON_FINITE),
        ({"device_time_s": NAN}, Reason.NON_FINITE),
        ({"lag_k": NAN}, Reason.NON_FINITE),
    ],
    ids=str,
)
def test_a_checkpoint_that_no_filter_could_go_on_from_is_refused(changes: dict[str, Any], reason: Reason) -> None:
    wrong = dataclasses.replace(KEPT, **changes)
    assert refused(codec.encode_checkpoint(wrong), CHECKPOINT, codec.decode_checkpoint) is reason


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"estimator": "e2"}, Reason.FOREIGN_ID),
        ({"holdings": (Holding("D 1", 1, 1, 1),)}, Reason.BAD_ID),
        ({"holdings": (Holding("d1", 2**63, 1, 1),)}, Reason.RANGE),
        ({"holdings": (Holding("d1", 1, 1, 1),) * 513}, Reason.LENGTH),
        ({"moves": (Move(1, 1, 1, ""),) * 9}, Reason.LENGTH),
        ({"part": 1}, Reason.RANGE),
        ({"parts": 65}, Reason.RANGE),
        ({"load": NAN}, Reason.NON_FINITE),
    ],
    ids=str,
)
def test_what_no_estimator_can_have_is_refused(changes: dict[str, Any], reason: Reason) -> None:
    owned = dataclasses.replace(Owned("e1", 9, 7, 0.5, ()), **changes)
    assert refused(codec.encode_owned(owned), OWN, codec.decode_owned) is reason


def test_a_payload_has_room_for_as_many_devices_as_are_taken() -> None:
    full = Owned(
        "e" * 32, 2**62, 2**62, 1.0, (Holding("d" * 32, 2**62, 2**64 - 1, 2**62, busy=True),) * codec.MAX_HOLDINGS,
        (Move(2**62, 4096, 4096, "x" * 500),) * 8,
    )  # fmt: skip
    assert len(codec.encode_owned(full)) <= codec.MAX_PAYLOAD
