"""A message of each kind, and the door it comes in at."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec
from bridge.wire.messages import (
    AccelerometerCalibration,
    Alert,
    BiasRevision,
    BootCause,
    Calibration,
    Checkpoint,
    Command,
    CommandReply,
    CorrectedBatch,
    DeviceCalibration,
    DeviceInfo,
    Holding,
    Move,
    Note,
    OrientationBatch,
    Owned,
    Placement,
    Quality,
    Receipt,
    SampleBatch,
    State,
    Status,
    Turn,
    Verdict,
    WindowBatch,
)
from bridge.wire.refusal import Reason, Refusal
from tests.bridge.wire.drawn import (
    CALIBRATION,
    CHECKPOINT,
    CORRECTED,
    INFO,
    NOTE,
    ORIENTATION,
    OWN,
    PARAMETERS,
    RAW,
    REVISION,
    RPC,
    STATUS,
    WINDOWED,
)
from tests.sentences import free


def plain(n: int = 4, **changes: Any) -> SampleBatch:
    batch = SampleBatch(
        "d1", 7, 100, 10**18, 10**18, 1e-6, 1.0, np.arange(n, dtype=np.uint64) * 10_000, np.ones((n, 3), np.float32),
        np.ones((n, 3), np.float32), np.full(n, 30, np.float32), np.zeros(n, np.uint32),
        "b1",
    )  # fmt: skip
    return dataclasses.replace(batch, **changes)


LEVEL = AccelerometerCalibration(
    Verdict.ACCEPTED, (Code.ACCELEROMETER_CALIBRATED(poses=6),), 6, (0.1, 0.0, -0.2), (1.0, 0.99, 1.01),
    tuple(np.eye(6).ravel().tolist()), 0.005,
)  # fmt: skip
STILL = Status(
    "d1", 7, 1, State.TRACKING, Quality.GOOD, free("fine"), 1.0, (0, 1, 2), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0),
    "c1", 1, 0.0, float("nan"), 100.0, 1, 1, {"a": 1}, {}, "b1", ("b2",), 3, Placement("humerus", "left", "bed-3", 9, "anna"),
    (Alert("lost", 5, 6, 7, "anna"), Alert("degraded", 5, 6)), LEVEL, 0.5,
    (Receipt(9, "zaru level", (0.1, -0.2), (0.3, 0.4), 2.5, 0.1, accepted=True),
     Receipt(9, "gravity", (3.0,), (0.0,), 1e12, 1e12, accepted=False, reason="not finite")),
)  # fmt: skip
CAL = Calibration(
    "d1", 7, "c1", 1, "closure", Verdict.ACCEPTED, (), np.eye(3), np.zeros(3), PARAMETERS, np.eye(6),
    (Turn(0, 6.28, 0.01, 5),), np.ones(3), "m", "f", 4.3, 100.0, float("nan"), "anna",
    accelerometer=LEVEL,
)  # fmt: skip
SURE = DeviceInfo(
    "d1", "b1", 7, BootCause.POWER_UP, "m", "f", "native", "/dev/x", 100, 99.9, 4.3, True, True, 1, 5, {"a": 1},
    battery_percent=71.5, charging=True, notices=(Code.CORRECTS_ITSELF(),),
    calibration=DeviceCalibration(7, 3, (0.9, 1.0, 1.1), (0.0, -0.25, 0.5)),
)  # fmt: skip
FIXED = CorrectedBatch(
    "d1", 7, 1, 1, 1e-6, 1.0, np.arange(3, dtype=np.uint64), np.ones((3, 3), np.float32), np.zeros(3, np.uint32),
    Quality.GOOD, np.ones(3, np.float32), np.ones(3, np.float32), np.ones(3, np.float32), np.ones(3, np.float32), "c1",
    np.ones(3, np.float32), flicker_std=np.ones(3, np.float32),
)  # fmt: skip
REVISED = BiasRevision(
    "d1", 7, "c1", 9, np.eye(3), np.array([3, 103, 203], np.uint64), np.array([10**18, 10**18 + 1, 10**18 + 9], np.int64),
    np.full((3, 3), 0.01, np.float32), np.full((3, 3), 1e-4, np.float32), (Code.AT_REST_AGAIN(gap_s=95),),
)  # fmt: skip
HALF, ONE = np.full((2, 3), 0.5, np.float32), np.ones(3, np.float32)
TURNED = OrientationBatch(
    "d1", 7, 1, 1, 1e-6, 1.0, np.arange(3, dtype=np.uint64), np.tile(np.array([0.6, 0.0, 0.8, 0.0], np.float32), (3, 1)),
    np.ones((3, 3), np.float32), np.eye(3, dtype=np.float32), 1, "start", Quality.GOOD, 5,
)  # fmt: skip
SEEN = WindowBatch(
    "d1", 7, 0.1, np.array([3, 13], np.uint64), np.array([10**18, 10**18 + 9], np.int64), np.array([4, 10], np.uint32),
    np.array([0, 2], np.uint32), HALF, HALF, HALF, HALF, HALF, HALF, HALF, HALF, Quality.GOOD, ONE, ONE, ONE, ONE, ONE, "c1", ONE,
)  # fmt: skip
KEPT = Checkpoint(
    "d1", 7, 1, 9, "b1", CAL, state=b"state", placement=STILL.placement, alerts=STILL.alerts,
)  # fmt: skip
DOORS: dict[str, tuple[Callable[[bytes], Any], bytes]] = {
    "samples": (lambda payload: codec.decode_samples(RAW, payload), codec.encode_samples(plain())),
    "corrected": (lambda payload: codec.decode_corrected(CORRECTED, payload), codec.encode_corrected(FIXED)),
    "info": (lambda payload: codec.decode_info(INFO, payload), codec.encode_info(SURE)),
    "status": (lambda payload: codec.decode_status(STATUS, payload), codec.encode_status(STILL)),
    "calibration": (lambda payload: codec.decode_calibration(CALIBRATION, payload), codec.encode_calibration(CAL)),
    "revision": (lambda payload: codec.decode_revision(REVISION, payload), codec.encode_revision(REVISED)),
    "orientation": (lambda payload: codec.decode_orientation(ORIENTATION, payload), codec.encode_orientation(TURNED)),
    "windows": (lambda payload: codec.decode_windows(WINDOWED, payload), codec.encode_windows(SEEN)),
    "note": (
        lambda payload: codec.decode_note(NOTE, payload),
        codec.encode_note(Note("d1", 7, 10**18, "anna", "sat up")),
    ),
    "owned": (
        lambda payload: codec.decode_owned(OWN, payload),
        codec.encode_owned(Owned("e1", 9, 7, 0.5, (Holding("d1", 7, 3, 9),), (Move(1, 2, 3, free("gone")),))),
    ),
    "checkpoint": (
        lambda payload: codec.decode_checkpoint(CHECKPOINT, payload),
        codec.encode_checkpoint(KEPT),
    ),
    "command": (
        lambda payload: codec.decode_command(RPC, payload),
        codec.encode_command(Command("r1", "anna", "why", STILL.placement)),
    ),
    "reply": (codec.decode_reply, codec.encode_reply(CommandReply("r1", True, free("done")))),
}


def refused(payload: bytes, key: str = RAW, decode: Callable[[str, bytes], Any] = codec.decode_samples) -> Reason:
    with pytest.raises(Refusal) as caught:
        decode(key, payload)
    return caught.value.reason


def try_door(door: Callable[[bytes], Any], payload: bytes) -> None:
    try:
        door(payload)
    except Refusal as refusal:
        said = refusal
    else:
        return
    assert isinstance(said.reason, Reason)
    assert len(said.detail) < 1000


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
