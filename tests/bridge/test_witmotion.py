"""WitMotion's frames, cycles and settings, against a device written from the manual."""

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.drivers.witmotion import WitMotionDecoder, WitMotionOptions, Word
from bridge.drivers.witmotion_cycle import Cycles
from bridge.framing.witmotion import WitFrames
from bridge.ingest.intake import Intake
from bridge.reasons.catalogue import english
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally
from tests.bridge.witmotion_device import WitDevice, checked, motion, time, unchecked

S = 1_000_000_000
TURN_NS = 20_000_000


class Bench:
    """A device and a decoder on a wire, in turns of 20 ms."""

    def __init__(self, device: WitDevice, decoder: WitMotionDecoder) -> None:
        self.device, self.decoder = device, decoder
        self.now_ns = 10**18
        self.events: list[Event] = []
        self._owed = 0.0

    def run(self, seconds: float) -> "Bench":
        for _ in range(round(seconds * S / TURN_NS)):
            self.device.receive(self.decoder.to_send())
            self.now_ns += TURN_NS
            self._owed += TURN_NS / S
            out = b""
            while self._owed >= 1 / self.device.rate_hz:
                self._owed -= 1 / self.device.rate_hz
                out += self.device.cycle()
            self.events += self.decoder.feed(out, self.now_ns)
        return self

    @property
    def identities(self) -> list[Identity]:
        return [event for event in self.events if isinstance(event, Identity)]

    @property
    def readings(self) -> list[Readings]:
        return [event for event in self.events if isinstance(event, Readings)]

    @property
    def notices(self) -> list[str]:
        return [english(event.said) for event in self.events if isinstance(event, Notice) and event.said]


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
    bench = Bench(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
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
    bench = Bench(WitDevice(old=False), WitMotionDecoder(options())).run(4)
    assert bench.device.registers[0x63] == 0xFFFF
    assert len(bench.notices) == 1
    assert "after 65.5 s at rest" in bench.notices[0]


def test_a_device_that_does_not_answer_is_read_all_the_same_and_that_is_said() -> None:
    bench = Bench(WitDevice(deaf=True), WitMotionDecoder(options())).run(5)
    assert len(bench.notices) == 1
    assert "does not say whether" in bench.notices[0]
    assert (bench.identities[0].rate_hz, bench.identities[0].has_clock) == (10.0, False)
    assert len(rates(bench.events)) > 20


def test_settings_are_left_alone_on_request_and_by_a_decoder_without_options() -> None:
    for decoder in (WitMotionDecoder(options(keep_settings=True)), WitMotionDecoder(None)):
        bench = Bench(WitDevice(), decoder).run(3)
        assert bench.device.commands == []
        assert bench.identities[0].rate_hz == 10.0, "counted, as it tells no time"


def test_a_bluetooth_device_is_asked_and_set_and_needs_no_time() -> None:
    bench = Bench(WitDevice(bluetooth=True), WitMotionDecoder(options(rate_hz=50.0))).run(6)
    assert (bench.identities[-1].rate_hz, bench.identities[-1].has_clock) == (50.0, False)
    assert bench.identities[-1].firmware == "4711"
    counts = rates(bench.events)
    assert counts == list(range(counts[0], counts[-1] + 1))


def test_a_device_that_loses_power_is_a_new_boot_and_is_set_again() -> None:
    bench = Bench(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
    bench.device.power_up()
    bench.run(8)
    assert [identity.boot_cause for identity in bench.identities] == [BootCause.PORT_OPENED, BootCause.POWER_UP]
    assert len({identity.boot for identity in bench.identities}) == 2
    assert bench.device.registers[0x02] == 0x07
    assert bench.device.registers[0x03] == 9
    last = bench.readings[-1]
    assert last.boot == bench.identities[-1].boot


def test_a_port_opened_again_is_the_same_boot_where_the_clock_went_on() -> None:
    bench = Bench(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
    bench.decoder.opened()
    bench.run(3)
    assert len({identity.boot for identity in bench.identities}) == 1


def test_every_lost_sample_of_a_device_with_a_clock_is_counted() -> None:
    bench = Bench(WitDevice(), WitMotionDecoder(options(rate_hz=100.0))).run(6)
    intake = Intake("d", "b", "witmotion", "p")
    for _ in range(37):
        bench.device.cycle()
    bench.now_ns += 370_000_000
    bench.run(3)
    for event in bench.events:
        intake.take(event)
    assert intake.events.as_dict() == {"gaps": 1, "missing_samples": 37}


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


def test_halves_with_a_fault_between_them_are_not_paired() -> None:
    decoder = listening()
    decoder.feed(3 * cycle(1), 1)
    broken = bytearray(motion(0x53, (1, 2, 3)))
    broken[4] ^= 1
    events = decoder.feed(motion(0x51, (7, 0, 0)) + bytes(broken) + motion(0x52, (7, 0, 0)) + cycle(9), 2)
    assert rates(events) == [9]
    assert decoder.faults.as_dict() == {
        "samples_before_settled": 1,
        "frame_bad_sum": 1,
        "bytes_between_frames": 11,
        "half_missing": 2,
    }


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


def test_a_calendar_that_nobody_has_set_goes_on_at_its_first_midnight() -> None:
    frames, cycles, found = WitFrames(Tally()), Cycles(Tally()), list[int]()
    for day, (hour, minute, second, ms) in ((0, (23, 59, 59, 990)), (1, (0, 0, 0, 0)), (2, (0, 0, 0, 0))):
        at = bytes((0, 0, day, hour, minute, second)) + ms.to_bytes(2, "little")
        for frame in frames.feed(checked(0x50, at) + motion(0x51, (0, 0, 1)) + motion(0x52, (1, 1, 1))):
            if (sample := cycles.take(frame)) is not None and sample.time_ms is not None:
                found.append(sample.time_ms)
    assert np.diff(found).tolist() == [10, 86_400_000]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate_hz": 104.0}, "rate_hz is 104; 0.2"),
        ({"rate_hz": 50.0, "baud": 9600}, "needs a baud of 16500"),
    ],
)
def test_options_that_cannot_work_are_refused_in_words(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        WitMotionOptions(port="p", **{"baud": 115_200, **change})  # type: ignore[arg-type]


# ---- laws of the frames -----------------------------------------------------------------------------------------------


def in_pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in pairwise(edges)]


raw = st.integers(-32768, 32767)
vectors = st.tuples(raw, raw, raw)
without_head = st.binary(max_size=60).map(lambda data: data.replace(b"\x55", b"\x54"))


@given(st.lists(vectors, min_size=1, max_size=20), st.lists(st.integers(0, 10_000), max_size=30), st.booleans())
def test_any_chunking_gives_the_same_frames(values: list[tuple[int, int, int]], cuts: list[int], serial: bool) -> None:
    data = b"".join(motion(0x52, value) if serial else unchecked(value, value) for value in values)
    if not serial:
        data += b"\x55\x61"
    whole, pieces = WitFrames(Tally()), WitFrames(Tally())
    expected = whole.feed(data)
    assert len(expected) == len(values)
    assert [frame for piece in in_pieces(data, cuts) for frame in pieces.feed(piece)] == expected
    assert whole.faults.as_dict() == pieces.faults.as_dict() == {}


@given(st.lists(st.tuples(without_head, vectors), min_size=1, max_size=10))
def test_no_frame_is_lost_to_rubbish_before_it(parts: list[tuple[bytes, tuple[int, int, int]]]) -> None:
    frames = WitFrames(Tally())
    found = frames.feed(b"".join(rubbish + motion(0x52, value) for rubbish, value in parts))
    assert [frame.data for frame in found] == [motion(0x52, value)[2:10] for _, value in parts]
    assert [frame.after_fault for frame in found] == [bool(rubbish) for rubbish, _ in parts]
    assert frames.faults.total() == sum(len(rubbish) for rubbish, _ in parts)


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


def test_no_more_passes_than_the_sum_lets_through() -> None:
    """Of random frames 1 in 256; of two bit errors 1 in 16, which nobody can help: the sum takes no account of order."""
    rng = np.random.default_rng(5)
    values = rng.integers(-32768, 32768, (20_000, 4)).tolist()
    frames = np.frombuffer(b"".join(motion(0x52, (x, y, z), w) for x, y, z, w in values), np.uint8).reshape(-1, 11)
    bits = np.unpackbits(frames, axis=1)
    first, second = rng.integers(16, 88, (2, len(bits)))  # anywhere but in its head
    rows = np.arange(len(bits))
    bits[rows, first] ^= 1
    bits[rows, second] ^= first != second
    damaged = np.packbits(bits, axis=1)
    right = damaged[:, :10].sum(axis=1) % 256 == damaged[:, 10]
    passed = np.array([len(WitFrames(Tally()).feed(one.tobytes())) == 1 for one in damaged])
    assert np.array_equal(passed, right)
    assert passed[first != second].mean() == pytest.approx(1 / 16, abs=0.01)
    random = rng.integers(0, 256, (20_000, 11), dtype=np.uint8)
    random[:, :2] = 0x55, 0x52
    passes = sum(len(WitFrames(Tally()).feed(one.tobytes())) for one in random)
    assert passes == pytest.approx(len(random) / 256, abs=40)
