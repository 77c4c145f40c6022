"""Xsens' messages, items and settings, against the manual's bytes and a device written from the manual."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.drivers.driver import Notice
from bridge.drivers.mtdata2 import MtData2Decoder, MtData2Options
from bridge.framing import mtdata2
from bridge.framing.mtdata2 import Messages, decode, encode
from bridge.framing.packets import BadPacket
from bridge.ingest.intake import Intake
from bridge.ingest.merge_readings import joined
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire.messages import BootCause, SampleFlag
from bridge.wire.refusal import Tally
from tests.bridge.drivers.emulated_line import Wire
from tests.bridge.drivers.mtdata2_device import F32, F64, FP1220, FP1632, MtDevice, item, message, reals

S = 1_000_000_000


def options(**more: object) -> MtData2Options:
    return MtData2Options(port="/dev/x", baud=921_600, **more)  # type: ignore[arg-type]


def taken(wire: Wire[MtDevice]) -> Intake:
    intake = Intake("d", "b", "mtdata2", "p")
    for event in wire.events:
        intake.take(event)
    return intake


def in_order(wire: Wire[MtDevice]) -> bool:
    counts = np.rint(np.concatenate([one.gyro[:, 0] for one in wire.readings]) * 1024).astype(int).tolist()
    return bool(counts == list(range(counts[0], counts[-1] + 1)))


def test_the_manual_s_messages() -> None:
    assert encode(mtdata2.REQ_DEVICE).hex(" ") == "fa ff 00 00 01"
    assert encode(mtdata2.GOTO_CONFIG).hex(" ") == "fa ff 30 00 d1"
    assert encode(mtdata2.GOTO_MEASUREMENT).hex(" ") == "fa ff 10 00 f1"
    assert encode(0xD0).hex(" ") == "fa ff d0 00 31"
    assert Messages(Tally()).feed(bytes.fromhex("fa ff d1 00 30")) == [(0xD1, b"")]


@pytest.mark.parametrize(("form", "error"), [(F32, 2**-20), (FP1220, 2**-20), (FP1632, 2**-32), (F64, 0.0)])
@given(st.tuples(*3 * [st.floats(-34, 34)]))
def test_numbers_of_every_format(form: int, error: float, values: tuple[float, float, float]) -> None:
    found = decode(reals(0x8020, values, form) + reals(0x0810, values[:1], form)).gyro
    assert found == pytest.approx(values, abs=error + 1e-15, rel=1e-7 if form == F32 else 1e-15)


@pytest.mark.parametrize(
    "data",
    [b"\x80", item(0x8020, bytes(11)), item(0x8023, bytes(12)), item(0x1020, b"\x01"), reals(0x8020, (1, 2, 3))[:-1]],
)
def test_items_that_do_not_fit_are_refused(data: bytes) -> None:
    with pytest.raises(BadPacket):
        decode(data)


def test_a_device_that_is_only_listened_to() -> None:
    bench = Wire(MtDevice(), MtData2Decoder(None)).run(3)
    assert bench.device.received == []
    first, last = bench.identities[0], bench.identities[-1]
    assert (first.model, first.rate_hz, first.has_clock, first.tick_period_s) == ("Xsens MT", 100.0, True, 1e-4)
    assert last.has_temperature
    assert in_order(bench), "over the wrap of the counter and of the clock"
    assert taken(bench).events.as_dict() == {}
    assert len({one.boot for one in bench.identities}) == 1


def test_a_device_that_is_asked_who_it_is() -> None:
    bench = Wire(MtDevice(), MtData2Decoder(options(ask=True))).run(3)
    identity = bench.identities[-1]
    assert (identity.model, identity.firmware) == ("MTi-30-2A8G4 0012AB34", "1.4.7")
    assert 0xC0 not in bench.device.received
    assert bench.device.measuring


def test_a_device_is_told_what_to_send() -> None:
    device = MtDevice(timed=False, rate_hz=20)
    bench = Wire(device, MtData2Decoder(options(rate_hz=400, gyro_range_dps=450))).run(3)
    identity = bench.identities[-1]
    assert (identity.rate_hz, identity.has_clock) == (400.0, True)
    assert identity.gyro_range == pytest.approx(np.radians(450))
    assert in_order(bench)


def test_a_device_that_is_deaf_is_read_all_the_same_and_that_is_said() -> None:
    bench = Wire(MtDevice(deaf=True), MtData2Decoder(options(rate_hz=400))).run(5)
    assert bench.notices == [english(Code.REQUEST_UNANSWERED(request="30"))]
    assert bench.identities[-1].rate_hz == 100.0
    received = len(bench.device.received)
    bench.run(3)
    assert len(bench.device.received) == received, "it measures: it is left at that"


@pytest.mark.parametrize("asks", [False, True])
def test_waking_up_is_a_boot(asks: bool) -> None:
    bench = Wire(MtDevice(), MtData2Decoder(options(ask=asks))).run(3)
    bench.device.out += bench.device.power_up()
    bench.run(3)
    assert [one.boot_cause for one in bench.identities if one.has_temperature] == [
        BootCause.PORT_OPENED,
        BootCause.POWER_UP,
    ]
    assert (0x3F in bench.device.received) == asks
    assert bench.device.measuring


@pytest.mark.parametrize("timed", [True, False])
def test_every_lost_message_is_counted_by_clock_and_by_count(timed: bool) -> None:
    bench = Wire(MtDevice(timed=timed), MtData2Decoder(None)).run(2)
    bench.device.live(37)
    bench.now_ns += 370_000_000
    bench.run(2)
    assert bench.decoder.faults.as_dict()["missing_messages"] == 37
    assert taken(bench).events.as_dict() == {"gaps": 1, "missing_samples": 37}


def test_a_device_that_sends_no_rate_of_turn_is_told_of() -> None:
    decoder = MtData2Decoder(None)
    events = [event for _ in range(300) for event in decoder.feed(message(0x36, item(0x1020, b"\0\1")), 1)]
    assert events == [Notice("output", Code.NO_RATE_OF_TURN())]


def test_what_the_device_itself_calls_clipped_is_marked_though_its_range_is_unknown() -> None:
    decoder, intake, flags = MtData2Decoder(None), Intake("d", "b", "mtdata2", "p"), list[int]()
    for n in range(60):
        word = 0x00481401 if n in (40, 41) else 0x00080401
        data = item(0x1060, struct.pack(">I", 100 * n)) + reals(0x8020, (1 + n / 1e3, 2, 3))
        for event in joined(decoder.feed(message(0x36, data + item(0xE020, struct.pack(">I", word))), n * S // 100)):
            flags += [flag for batch in intake.take(event) for flag in batch.flags.tolist()]
    assert [n for n, flag in enumerate(flags, 1) if flag] == [40, 41]  # of the first nobody knows whether it is timed
    assert set(flags) == {0, SampleFlag.CLIPPED}
    assert intake.events.as_dict() == {"clipped": 2}


# ---- laws of the messages ---------------------------------------------------------------------------------------------
