"""The door of a device: everything that comes is published or counted, and what is published is always valid."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.drivers.driver import Identity, Notice, Readings
from bridge.ingest.intake import Intake
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, DeviceCalibration, SampleBatch, SampleFlag
from tests.sentences import codes, free

NOW = 1_700_000_000 * 10**9
DT = 10_000  # ticks
HELLO = Identity(7, BootCause.POWER_UP, "m", "f", 100.0, 4.0, 1e-6, True, True)
KEY = keys.build("w", "raw", bridge="b", device="d")


def made() -> Intake:
    return Intake("d", "b", "native", "/dev/x")


def readings(sequence: int, n: int = 5, boot: int = 7, **changes: Any) -> Readings:
    ticks = ((sequence + np.arange(n)) * DT) % 2**32
    plain = Readings(
        boot, sequence % 2**32, NOW + (sequence + n) * DT * 1000, ticks.astype(np.uint32), np.full((n, 3), 0.5, np.float32),
        np.full((n, 3), 9.8, np.float32), np.full(n, 30, np.float32),
    )  # fmt: skip
    return replace(plain, **changes)


def account(intake: Intake) -> None:
    assert intake.samples_in == intake.samples + intake.dropped.total()


def spans(batches: list[SampleBatch]) -> list[tuple[int, int]]:
    return [(batch.sequence, len(batch)) for batch in batches]


def test_a_calibration_of_the_device_s_own_is_told_while_its_boot_lasts() -> None:
    intake, own = made(), DeviceCalibration(7, 3, (0.9, 1.0, 1.1), (0.0, -0.25, 0.5))
    intake.take(own)
    assert intake.info(NOW, {}).calibration is None, "of nobody knows which boot"
    intake.take(HELLO)
    intake.take(replace(own, boot=8))
    assert intake.info(NOW, {}).calibration is None
    intake.take(own)
    info = intake.info(NOW, {})
    assert (info.calibration, info.events) == (own, {"own_calibration_of_another_boot": 2})
    intake.take(replace(HELLO, boot=8))
    assert intake.info(NOW, {}).calibration is None


def test_another_rate_in_a_boot_is_no_boot_and_is_measured_anew() -> None:
    intake = made()
    intake.take(HELLO)
    for i in range(100):
        intake.take(readings(5 * i))
    assert intake.info(NOW, {}).measured_rate_hz == pytest.approx(100.0, rel=1e-3)
    intake.take(replace(HELLO, rate_hz=400.0))
    ticks = 500 * DT + np.arange(800) * DT // 4
    for i in range(0, 800, 5):
        fast = replace(readings(500 + i), ticks=ticks[i : i + 5].astype(np.uint32))
        intake.take(replace(fast, receive_time_ns=NOW + int(ticks[i + 4]) * 1000))
    info = intake.info(NOW, {})
    assert (info.boot, info.rate_hz, info.samples, info.events) == (7, 400.0, 1300, {"rate_changed": 1})
    changed = Code.RATE_CHANGED(then_hz="100", now_hz="400")
    assert (info.notices, intake.said) == ((changed,), [english(changed)])
    assert info.measured_rate_hz == pytest.approx(400.0, rel=1e-2)
    account(intake)


def test_nothing_is_published_before_the_device_said_who_it_is() -> None:
    intake = made()
    assert intake.take(readings(0)) == []
    info = intake.info(NOW, {})
    assert (info.device, info.boot, info.boot_cause) == ("d", 0, BootCause.UNKNOWN)
    assert info.trouble == (Code.NOTHING_HEARD(place="/dev/x"),)
    assert intake.info(NOW, {}, free("busy")).trouble == free("busy")
    account(intake)
    intake.take(HELLO)
    assert intake.take(readings(5))[0].sequence == 5
    assert intake.events.as_dict() == {"before_identity": 5}
    account(intake)


def test_what_was_there_already_is_dropped() -> None:
    intake = made()
    intake.take(HELLO)
    intake.take(readings(0, 10))
    assert intake.take(readings(3, 5)) == []
    assert spans(intake.take(readings(8, 5))) == [(10, 3)]
    assert intake.dropped.as_dict() == {"duplicate": 7}
    assert intake.events.as_dict() == {}
    account(intake)


def test_a_datagram_that_was_overtaken_is_no_duplicate() -> None:
    intake = made()
    intake.take(HELLO)
    intake.take(readings(0))
    intake.take(readings(10))
    assert intake.take(readings(5)) == []
    assert intake.dropped.as_dict() == {"reordered": 5}
    assert intake.take(readings(5)) == []
    assert intake.dropped.as_dict() == {"reordered": 5, "duplicate": 5}
    assert spans(intake.take(readings(15))) == [(15, 5)]
    assert intake.events.as_dict() == {"gaps": 1, "missing_samples": 5}
    account(intake)


def test_a_clock_that_is_not_what_it_says_is_told() -> None:
    intake = made()
    intake.take(HELLO)
    for i in range(500):
        intake.take(readings(5 * i, receive_time_ns=NOW + 5 * i * DT * 500))
    info = intake.info(NOW, {})
    assert info.measured_rate_hz == pytest.approx(200, rel=1e-3)
    assert info.events == {"rate_differs": 1}
    assert info.notices == (Code.RATE_DIFFERS(measured_hz="200", told_hz="100"), Code.CLOCK_DIFFERS(times="2"))


def test_a_device_s_own_notices_stay_beside_ours() -> None:
    intake = made()
    intake.take(replace(HELLO, has_clock=False))
    intake.take(Notice("battery", free("old")[0]))
    assert codes(intake.info(NOW, {}).notices) == [Code.PROFILE_NOTICE, Code.RATE_PRESUMED]
    for i in range(20):
        intake.take(Notice(f"n{i}", free("x")[0]))
    notices = intake.info(NOW, {}).notices
    assert len(notices) == 16
    assert notices[-1].code == Code.RATE_PRESUMED


def test_samples_that_are_no_numbers_split_the_batch() -> None:
    intake = made()
    intake.take(HELLO)
    gyro = np.full((5, 3), 0.5)
    gyro[2, 1] = np.nan
    first, second = intake.take(readings(0, gyro=gyro))
    assert spans([first, second]) == [(0, 2), (3, 2)]
    assert second.flags.tolist() == [SampleFlag.AFTER_GAP, 0]
    assert intake.dropped.as_dict() == {"non_finite": 1}
    account(intake)


def test_clipping_is_flagged_and_the_implausible_dropped() -> None:
    intake = made()
    intake.take(HELLO)
    gyro = np.array([[0, 0, 0], [0, -3.97, 0], [0, 0, 3.9], [8.1, 0, 0], [4.0, 0, 0]])
    first, second = intake.take(readings(0, gyro=gyro))
    assert first.flags.tolist() == [0, SampleFlag.CLIPPED, 0]
    assert second.flags.tolist() == [SampleFlag.CLIPPED | SampleFlag.AFTER_GAP]
    assert intake.dropped.as_dict() == {"range": 1}
    account(intake)


def test_a_bad_temperature_costs_its_column_only() -> None:
    intake = made()
    intake.take(HELLO)
    (batch,) = intake.take(readings(0, temperature_c=np.array([30, np.nan, 30, 30, 30])))
    assert batch.temperature_c is None
    assert intake.events.as_dict() == {"temperature_missing": 5}


@pytest.mark.parametrize(
    "changes",
    [
        {"gyro": np.zeros((4, 3))}, {"accel": np.zeros((5, 2))}, {"temperature_c": np.zeros(6)},
        {"ticks": np.full(5, 2**63, np.uint64)},
    ],
)  # fmt: skip
def test_readings_that_are_not_whole_are_dropped(changes: dict[str, Any]) -> None:
    intake = made()
    intake.take(replace(HELLO, tick_bits=64, sequence_bits=64))
    assert intake.take(readings(0, **changes)) == []
    assert intake.take(replace(readings(0), sequence=2**63)) == []
    account(intake)


def test_counters_go_on_over_their_wrap_and_over_a_long_silence() -> None:
    intake = made()
    intake.take(HELLO)
    at = 2**32 // DT - 2
    first = intake.take(readings(at, 2))
    (batch,) = intake.take(readings(at + 2))
    assert batch.sequence == at + 2
    assert batch.ticks.tolist() == [(at + 2 + i) * DT for i in range(5)]
    days = at + 2 * 24 * 3600 * 100
    (batch,) = intake.take(readings(days))
    assert batch.ticks[0] == days * DT
    assert batch.flags[0] == SampleFlag.AFTER_GAP
    assert first[0].ticks[0] == at * DT


def test_a_reboot_begins_a_new_account_and_late_samples_of_the_old_are_dropped() -> None:
    intake = made()
    intake.take(HELLO)
    intake.take(readings(0))
    intake.take(replace(HELLO, boot=8))
    assert intake.take(readings(5)) == []
    (batch,) = intake.take(readings(0, boot=8))
    assert (batch.boot, batch.sequence, batch.flags[0]) == (8, 0, 0)
    assert (intake.samples, intake.dropped.as_dict()) == (5, {"old_boot": 5})
    assert intake.events.as_dict() == {"reboots": 1}
    account(intake)


def test_a_reboot_that_keeps_its_boot_number_is_seen_within_two_seconds() -> None:
    intake = made()
    intake.take(HELLO)
    for i in range(200):
        intake.take(readings(5 * i))
    batches = [batch for i in range(40) for batch in intake.take(readings(5 * i))]
    assert batches
    assert batches[0].boot not in (7, 0)
    assert batches[0].sequence <= 110
    assert intake.boot == batches[0].boot
    assert intake.events.as_dict() == {"reboots_unsaid": 1}
    assert intake.dropped.as_dict() == {"duplicate": 100}  # what led to it
    account(intake)
    intake.take(HELLO)
    assert intake.take(readings(200))[0].boot == batches[0].boot


def test_a_batch_that_could_not_be_kept_is_counted_as_dropped() -> None:
    intake = made()
    intake.take(HELLO)
    (batch,) = intake.take(readings(0))
    intake.overflowed(batch)
    assert (intake.samples, intake.dropped.as_dict()) == (0, {"overflow": 5})
    account(intake)


FAULTS = st.sampled_from(["good", "good", "good", "lose", "repeat", "nan", "huge", "boot", "hello", "old", "ragged"])


@settings(max_examples=50)
@given(st.lists(st.tuples(FAULTS, st.integers(1, 8)), max_size=60))
def test_whatever_comes_is_published_or_counted_and_valid(story: list[tuple[str, int]]) -> None:
    intake, boot, sequence = made(), 7, 2**32 - 50
    last: dict[int, int] = {}
    intake.take(HELLO)
    for what, n in story:
        event: Identity | Readings = readings(sequence, n, boot)
        if what == "lose":
            sequence += n
            continue
        if what == "boot":
            boot, sequence = boot + 1, 0
            event = replace(HELLO, boot=boot)
        elif what == "hello":
            event = replace(HELLO, boot=boot)
        elif what == "repeat":
            event = readings(max(0, sequence - n), n, boot)
        elif what == "old":
            event = readings(sequence, n, boot - 1)
        elif what == "ragged":
            event = readings(sequence, n, boot, gyro=np.zeros((n + 1, 3)))
        elif what in {"nan", "huge"}:
            gyro = np.ones((n, 3))
            gyro[n // 2] = np.nan if what == "nan" else 1e30
            event = readings(sequence, n, boot, gyro=gyro)
        for batch in intake.take(event):
            valid = codec.decode_samples(KEY, codec.encode_samples(batch))
            assert valid.sequence > last.get(valid.boot, -1)
            hole = valid.sequence != last.get(valid.boot, valid.sequence - 1) + 1
            assert bool(valid.flags[0] & SampleFlag.AFTER_GAP) == hole
            last[valid.boot] = valid.sequence + len(valid) - 1
        if what in {"good", "nan", "huge"}:
            sequence += n
        account(intake)
