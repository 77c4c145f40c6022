"""What is foreign or out of bounds is refused, with its reason."""

import dataclasses
import struct
from typing import Any

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, columns_pb2, keys, truerate_pb2
from bridge.wire.messages import (
    BiasRevision,
    BootCause,
    Command,
    DeviceInfo,
    SampleFlag,
)
from bridge.wire.refusal import Reason
from tests.bridge.wire.drawn import (
    CALIBRATION,
    CORRECTED,
    INF,
    INFO,
    NAN,
    ORIENTATION,
    RAW,
    REVISION,
    RPC,
    STATUS,
    WINDOWED,
)
from tests.bridge.wire.examples import (
    CAL,
    DOORS,
    FIXED,
    REVISED,
    SEEN,
    STILL,
    SURE,
    TURNED,
    assert_same,
    plain,
    refused,
    try_door,
)
from tests.sentences import free

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
    ({"flicker_std": np.full(3, -1, np.float32)}, Reason.RANGE),
    ({"flicker_std": np.ones(2, np.float32)}, Reason.LENGTH),
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
        REVISED, boot=2**64 - 1, calibration="😀" * 64, time_ns=2**62, reason=free("😀" * 500),
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
    trouble = (Code.PORT_MISSING(place="/dev/x"),)
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
    long = dataclasses.replace(SURE, trouble=free("x\n" * 999))
    [said] = codec.decode_info(INFO, codec.encode_info(long)).trouble
    assert len(said.params["words"]) == 500


def test_a_command_must_be_known_and_carry_a_request_id() -> None:
    good = codec.encode_command(Command("r1", "anna", ""))
    assert refused(good, keys.build("ward", "rpc", device="d1", verb="explode"), codec.decode_command) is Reason.BAD_KEY
    assert refused(codec.encode_command(Command("", "a", "")), RPC, codec.decode_command) is Reason.LENGTH


def test_an_unknown_state_or_a_negative_deviation_is_refused() -> None:
    raw = truerate_pb2.Status.FromString(codec.encode_status(STILL))
    raw.state = 99  # type: ignore[assignment]
    assert refused(raw.SerializeToString(), STATUS, codec.decode_status) is Reason.RANGE
    wrong = np.array([1, -1, 1], np.float32)
    for bad in (dataclasses.replace(FIXED, bias_std=wrong), dataclasses.replace(FIXED, flicker_std=wrong)):
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


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"quat_wxyz": np.ones((3, 4), np.float32)}, Reason.RANGE),
        ({"quat_wxyz": np.full((3, 4), 0.1, np.float32)}, Reason.RANGE),
        ({"quat_wxyz": np.full((2, 4), 0.5, np.float32)}, Reason.LENGTH),
        ({"covariance": -np.eye(3, dtype=np.float32)}, Reason.RANGE),
        ({"linear_accel": np.full((3, 3), np.nan, np.float32)}, Reason.NON_FINITE),
    ],
)
def test_an_orientation_that_cannot_be(changes: dict[str, Any], reason: Reason) -> None:
    payload = codec.encode_orientation(dataclasses.replace(TURNED, **changes))
    assert refused(payload, ORIENTATION, codec.decode_orientation) is reason
