"""WitMotion's frames, cycles and settings, against a device written from the manual."""

from collections.abc import Sequence
from datetime import datetime
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.drivers.witmotion import WitMotionDecoder, WitMotionOptions, Word
from bridge.framing.witmotion import WitFrames
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally
from tests.bridge.drivers.emulated_line import Wire
from tests.bridge.drivers.witmotion_device import WitDevice, checked, motion, time, unchecked

S = 1_000_000_000
TURN_NS = 20_000_000


def options(**more: object) -> WitMotionOptions:
    return WitMotionOptions(port="/dev/x", baud=115_200, **more)  # type: ignore[arg-type]


def listening(rate_hz: float = 100.0) -> WitMotionDecoder:
    return WitMotionDecoder(options(rate_hz=rate_hz, keep_settings=True))


def rates(events: Sequence[Event]) -> list[int]:
    """The counts that the device had put into the x axis."""
    gyro = [event.gyro[:, 0] for event in events if isinstance(event, Readings)]
    return np.rint(np.concatenate(gyro) * 32768 / radians(2000)).astype(int).tolist() if gyro else []


def cycle(count: int, at: datetime | None = None) -> bytes:
    head = b"" if at is None else time(at)
    return head + motion(0x51, (count, 0, 2048), 2512) + motion(0x52, (count, 3, 4)) + motion(0x53, (1, 2, 3))


def test_units_are_those_of_the_manual() -> None:
    decoder = listening()
    data = motion(0x51, (2048, -2048, 32767), 2512) + motion(0x52, (16384, -16384, 32767), 99)
    events = decoder.feed(3 * data, 1)
    identity, readings = events
    assert isinstance(identity, Identity)
    assert isinstance(readings, Readings)
    assert readings.accel is not None
    assert readings.temperature_c is not None
    assert np.degrees(readings.gyro[0]) == pytest.approx([1000, -1000, 2000], rel=1e-4)
    assert readings.accel[0] / 9.80665 == pytest.approx([1, -1, 16], rel=1e-4)
    assert readings.temperature_c[0] == 25.12
    assert (identity.rate_hz, identity.has_clock, identity.gyro_range) == (100.0, False, radians(2000))


@pytest.mark.parametrize(("word", "celsius"), [(Word.ACCEL, 25.12), (Word.GYRO, 0.99), (Word.NONE, None)])
def test_the_temperature_is_where_the_options_say(word: Word, celsius: float | None) -> None:
    decoder = WitMotionDecoder(options(keep_settings=True, rate_hz=100.0, temperature=word))
    events = decoder.feed(3 * (motion(0x51, (1, 2, 3), 2512) + motion(0x52, (1, 2, 3), 99)), 1)
    readings = events[-1]
    assert isinstance(readings, Readings)
    column = None if readings.temperature_c is None else readings.temperature_c[0]
    assert column == celsius


def test_the_device_is_asked_set_and_given_a_clock() -> None:
    bench = Wire(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
    identity = bench.identities[-1]
    assert (identity.rate_hz, identity.firmware, identity.has_clock) == (100.0, "4711", True)
    assert bench.device.registers[0x02] == 0x07
    assert bench.device.registers[0x63] == 1
    assert bytes.fromhex("FFAA000000") not in bench.device.commands, "nothing is saved"
    assert bench.notices == []
    counts = rates(bench.events)
    assert counts == list(range(counts[0], counts[-1] + 1))
    assert bench.readings[0].sequence == 0


def test_a_newer_device_cannot_be_kept_from_calibrating_itself_and_that_is_said() -> None:
    bench = Wire(WitDevice(old=False), WitMotionDecoder(options())).run(4)
    assert bench.device.registers[0x63] == 0xFFFF
    assert len(bench.notices) == 1
    assert "after 65.5 s at rest" in bench.notices[0]


def test_a_device_that_does_not_answer_is_read_all_the_same_and_that_is_said() -> None:
    bench = Wire(WitDevice(deaf=True), WitMotionDecoder(options())).run(5)
    assert len(bench.notices) == 1
    assert "does not report" in bench.notices[0]
    assert (bench.identities[0].rate_hz, bench.identities[0].has_clock) == (10.0, False)
    assert len(rates(bench.events)) > 20


def test_settings_are_left_alone_on_request_and_by_a_decoder_without_options() -> None:
    for decoder in (WitMotionDecoder(options(keep_settings=True)), WitMotionDecoder(None)):
        bench = Wire(WitDevice(), decoder).run(3)
        assert bench.device.commands == []
        assert bench.identities[0].rate_hz == 10.0, "counted, as it tells no time"


def test_a_bluetooth_device_is_asked_and_set_and_needs_no_time() -> None:
    device = WitDevice(bluetooth=True)
    bench = Wire(device, WitMotionDecoder(options(rate_hz=50.0))).run(6)
    assert not [event for event in bench.events if isinstance(event, Battery)], "0 V is not measured yet"
    device.registers[0x64] = 375
    bench.run(60)
    device.registers[0x64] = 301
    assert [event for event in bench.run(60).events if isinstance(event, Battery)] == [Battery(25.0), Battery(0.0)]
    assert bench.notices == []
    assert (bench.identities[-1].rate_hz, bench.identities[-1].has_clock) == (50.0, False)
    assert bench.identities[-1].firmware == "4711"
    counts = rates(bench.events)
    assert counts == list(range(counts[0], counts[-1] + 1))


def test_a_device_that_loses_power_is_a_new_boot_and_is_set_again() -> None:
    bench = Wire(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
    bench.device.power_up()
    bench.run(8)
    assert [identity.boot_cause for identity in bench.identities] == [BootCause.PORT_OPENED, BootCause.POWER_UP]
    assert len({identity.boot for identity in bench.identities}) == 2
    assert bench.device.registers[0x02] == 0x07
    assert bench.device.registers[0x03] == 9
    last = bench.readings[-1]
    assert last.boot == bench.identities[-1].boot


@pytest.mark.parametrize("lost", [0x51, 0x52])
def test_halves_of_different_cycles_are_never_paired(lost: int) -> None:
    decoder = listening()
    decoder.feed(3 * cycle(1), 1)
    halves = {0x51: motion(0x52, (7, 0, 0)), 0x52: motion(0x51, (7, 0, 0))}
    events = decoder.feed(halves[lost] + motion(0x53, (1, 2, 3)) + cycle(9) + cycle(10), 2)
    [readings] = [event for event in events if isinstance(event, Readings)]
    assert readings.accel is not None
    assert rates(events) == [9, 10]
    assert np.rint(readings.accel[:, 0] * 32768 / 16 / 9.80665).tolist() == [9, 10]
    assert decoder.faults.as_dict()["half_missing"] == 1


def test_a_device_that_sends_rates_only_is_read() -> None:
    decoder = listening()
    events = decoder.feed(b"".join(motion(0x52, (i, 0, 0)) for i in range(20)), 1)
    assert rates(events) == list(range(8, 20))
    assert isinstance(events[0], Identity)
    assert not events[0].has_accel
    assert not events[0].has_temperature


def test_a_calendar_that_nobody_has_set_is_a_clock_and_nonsense_is_counted() -> None:
    decoder = WitMotionDecoder(options(keep_settings=True))
    zero = checked(0x50, bytes(8))
    nonsense = checked(0x50, bytes((99, 77, 1, 1, 1, 1, 0, 0)))
    gyro = motion(0x51, (0, 0, 1)) + motion(0x52, (1, 1, 1))
    decoder.feed(zero + gyro + zero + gyro + nonsense + gyro, 1)
    assert decoder.faults.as_dict() == {"samples_before_settled": 1, "bad_time": 1, "time_missing": 1}


# ---- laws of the frames -----------------------------------------------------------------------------------------------


raw = st.integers(-32768, 32767)
vectors = st.tuples(raw, raw, raw)


@given(st.lists(vectors, min_size=6, max_size=9, unique=True), st.integers(0, 10_000))
def test_a_lost_byte_of_a_bluetooth_frame_makes_no_wrong_one(values: list[tuple[int, int, int]], at: int) -> None:
    whole = [unchecked(value, value) for value in values]
    hit = 2 + at % (len(whole) - 4)
    broken = bytearray(whole[hit])
    del broken[at % 20]
    data = b"".join(bytes(broken) if i == hit else one for i, one in enumerate(whole))
    found = [frame.data for frame in WitFrames(Tally()).feed(data + b"\x55\x61")]
    right = [one[2:] for one in whole]
    assert [one for one in found if one not in right] == []
    assert set(right) - set(found) <= {right[hit - 1], right[hit], right[hit + 1]}


@given(vectors, st.integers(0, 87))
def test_no_single_bit_error_passes(value: tuple[int, int, int], bit: int) -> None:
    data = bytearray(motion(0x52, value))
    data[bit // 8] ^= 1 << bit % 8
    assert WitFrames(Tally()).feed(bytes(data)) == []
