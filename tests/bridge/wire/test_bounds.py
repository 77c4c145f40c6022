"""The bounds of docs/wire.md: what is at one is taken, what is beyond it refused."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from google.protobuf.message import Message

from bridge.wire import codec
from bridge.wire import truerate_pb2 as pb
from bridge.wire.messages import Owned
from bridge.wire.refusal import Reason, Refusal
from tests.bridge.wire.drawn import CALIBRATION, CHECKPOINT, INFO, OWN, REVISION, STATUS
from tests.bridge.wire.examples import CAL, KEPT, REVISED, STILL, SURE


class Door(NamedTuple):
    """A good payload, what it is, and who takes it under which key."""

    payload: bytes
    kind: type[Message]
    key: str
    decode: Callable[[str, bytes], Any]


DOORS = {
    "info": Door(codec.encode_info(SURE), pb.DeviceInfo, INFO, codec.decode_info),
    "status": Door(codec.encode_status(STILL), pb.Status, STATUS, codec.decode_status),
    "calibration": Door(codec.encode_calibration(CAL), pb.Calibration, CALIBRATION, codec.decode_calibration),
    "revision": Door(codec.encode_revision(REVISED), pb.BiasRevision, REVISION, codec.decode_revision),
    "checkpoint": Door(codec.encode_checkpoint(KEPT), pb.Checkpoint, CHECKPOINT, codec.decode_checkpoint),
    "owned": Door(codec.encode_owned(Owned("e1", 9, 7, 0.5, ())), pb.Owned, OWN, codec.decode_owned),
}


def taken(what: str, **fields: Any) -> bool:
    """Whether a message is taken with these fields; a list replaces a list, and else its first element is replaced."""
    door = DOORS[what]
    message = door.kind.FromString(door.payload)
    for name, value in fields.items():
        held = getattr(message, name)
        if isinstance(value, dict):
            held.clear()
            held.update(value)
        elif isinstance(value, list):
            message.ClearField(name)
            getattr(message, name).extend(value)
        elif hasattr(held, "extend"):
            held[0] = value
        else:
            setattr(message, name, value)
    try:
        door.decode(door.key, message.SerializeToString())
    except Refusal as refusal:
        return refusal.reason not in (Reason.RANGE, Reason.LENGTH)  # for anything else it was not refused rightly
    return True


def beyond(value: float) -> float:
    return float(np.nextafter(value, np.inf if value > 0 else -np.inf)) if value else -1e-9


@pytest.mark.parametrize(
    ("what", "field", "low", "high"),
    [
        ("info", "rate_hz", 0, 1e6),
        ("info", "measured_rate_hz", 0, 1e9),
        ("info", "gyro_range", 0, 1000),
        ("info", "battery_percent", 0, 100),
        ("status", "progress", 0, 1),
        ("status", "bias", -1000, 1000),
        ("status", "bias_std", 0, 1e6),
        ("status", "scale", -10, 10),
        ("status", "evidence_age_s", 0, 1e12),
        ("status", "temperature_c", -500, 500),
        ("status", "rate_hz", 0, 1e6),
        ("status", "nis", 0, 1e12),
        ("calibration", "matrix", -10, 10),
        ("calibration", "bias", -1000, 1000),
        ("calibration", "covariance", -1e6, 1e6),
        ("calibration", "noise_std", 0, 1e6),
        ("calibration", "gyro_range", 0, 1000),
        ("calibration", "rate_hz", 0, 1e6),
        ("calibration", "temperature_c", -500, 500),
        ("revision", "matrix", -10, 10),
        ("owned", "load", 0, 1e4),
    ],
)
def test_numbers(what: str, field: str, low: float, high: float) -> None:
    assert [taken(what, **{field: value}) for value in (low, high)] == [True, True]
    assert [taken(what, **{field: beyond(value)}) for value in (low, high)] == [False, False]


@pytest.mark.parametrize(
    ("field", "low", "high"), [("angle", -100, 100), ("closure_error", 0, 100), ("duration_s", 0, 1e6)]
)
def test_numbers_of_a_turn(field: str, low: float, high: float) -> None:
    def turn(value: float) -> bool:
        return taken("calibration", turns=[pb.Turn(**{field: value})])  # type: ignore[arg-type]

    assert [turn(low), turn(high), turn(beyond(low)), turn(beyond(high))] == [True, True, False, False]
    assert [taken("calibration", turns=[pb.Turn(axis=axis)]) for axis in (2, 3)] == [True, False]


def test_a_receipt_has_one_to_three_innovations_within_the_range_of_rates() -> None:
    def receipt(innovation: list[float], std: list[float], **more: float) -> bool:
        return taken("status", receipts=[pb.Receipt(innovation=innovation, innovation_std=std, **more)])  # type: ignore[arg-type]

    assert receipt([1000.0, -1000.0, 0.0], [1e6, 0.0, 0.0], nis=1e12, test_ratio=1e12)
    assert not any(receipt([0.0] * n, [0.0] * n) for n in (0, 4))
    assert not any(receipt(*wrong) for wrong in (([0.0], [0.0, 0.0]), ([1001.0], [0.0]), ([0.0], [-1e-9])))
    assert not receipt([0.0], [0.0], nis=beyond(1e12))


@pytest.mark.parametrize(
    ("what", "field", "most", "one"),
    [
        ("info", "notices", 16, pb.Sentence(code="x")),
        ("info", "trouble", 16, pb.Sentence(code="x")),
        ("status", "reason", 16, pb.Sentence(code="x")),
        ("info", "events", 64, 1),
        ("status", "dropped", 64, 1),
        ("status", "refused_bridges", 16, "b1"),
        ("status", "axes_done", 3, 2),
        ("status", "receipts", 16, pb.Receipt(innovation=[0.0], innovation_std=[0.0])),
        ("calibration", "turns", 32, pb.Turn()),
        ("owned", "holdings", 512, pb.Holding(device="d1")),
        ("owned", "moves", 8, pb.Move()),
    ],
)
def test_how_many(what: str, field: str, most: int, one: Any) -> None:
    named = field in ("events", "dropped")
    full, over = ({str(i): one for i in range(n)} if named else [one] * n for n in (most, most + 1))
    assert [taken(what, **{field: full}), taken(what, **{field: over})] == [True, False]


@pytest.mark.parametrize(
    ("full", "over"),
    [
        (pb.Sentence(code="c" * 64), pb.Sentence(code="c" * 65)),
        (pb.Sentence(params={str(i): "" for i in range(8)}), pb.Sentence(params={str(i): "" for i in range(9)})),
        (pb.Sentence(params={"n" * 64: "ü" * 500}), pb.Sentence(params={"n": "ü" * 501})),
    ],
)
def test_how_long_a_sentence_may_be(full: pb.Sentence, over: pb.Sentence) -> None:
    assert [taken("status", reason=[one]) for one in (full, over)] == [True, False]


def test_how_many_parameters() -> None:
    for n, is_taken in ((32, True), (33, False)):
        assert taken("calibration", parameters=["p"] * n, covariance=[0.0] * n * n) is is_taken


@pytest.mark.parametrize(
    ("what", "field", "most"),
    [
        ("info", "model", 64),
        ("info", "port", 256),
        ("calibration", "who", 64),
    ],
)
def test_how_long(what: str, field: str, most: int) -> None:
    assert [taken(what, **{field: "ü" * n}) for n in (most, most + 1)] == [True, False]
