"""The profiles that come with truerate, on what their devices print: the right numbers, boots, and every torn row refused."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.drivers.text_profile import TextDecoder
from bridge.reasons.codes import Code
from bridge.text.profile import load_profile, shipped
from bridge.wire.messages import BootCause
from tests.bridge.text import printed

Prints = Callable[..., bytes]
# Who prints what; the rate where the profile leaves it to the ward's file; the step of what is printed, °/s.
PRINTED: dict[str, tuple[Prints, float, float]] = {
    "adafruit-raw": (printed.adafruit, 80.0, 0.0625),
    "adafruit-uni": (printed.adafruit, 80.0, np.degrees(0.0001)),
    "icm-20948-sparkfun": (printed.icm, 31.0, 0.01),
    "nano-33-ble": (printed.nano, 0.0, 0.01),
    "openlog-artemis": (printed.artemis, 0.0, 0.01),
    "razor-m0": (printed.razor, 0.0, 0.01),
}
NAMES = sorted(PRINTED)


def decoder(name: str) -> TextDecoder:
    return TextDecoder(load_profile(name), PRINTED[name][1])


def read(name: str, data: bytes) -> tuple[list[Event], dict[str, int]]:
    """What comes of it, of a port that was opened between two lines."""
    one = decoder(name)
    events = one.feed(b"\n" + data, 0)
    return [*events, *one.finish()], one.faults.as_dict()


def gyro(events: list[Event]) -> NDArray[np.float64]:
    """°/s"""
    runs = [event.gyro for event in events if isinstance(event, Readings)]
    return np.asarray(np.degrees(np.concatenate([np.empty((0, 3)), *runs])), np.float64)


def identities(events: list[Event]) -> list[Identity]:
    return [event for event in events if isinstance(event, Identity)]


def test_every_shipped_profile_is_tried() -> None:
    assert sorted(shipped()) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_device_is_understood_row_by_row(name: str) -> None:
    prints, _, step = PRINTED[name]
    events, faults = read(name, prints(120))
    assert faults == {}
    assert np.allclose(gyro(events), [printed.turn(i) for i in range(120)], atol=1.001 * step)
    assert len(identities(events)) == 1
    for event in events:
        if isinstance(event, Readings) and event.accel is not None:
            assert np.allclose(np.linalg.norm(event.accel, axis=1), 9.8, atol=0.03)
        if isinstance(event, Readings) and event.temperature_c is not None:
            assert np.all((event.temperature_c > 27) & (event.temperature_c < 31))


@pytest.mark.parametrize(
    ("name", "rate_hz", "has_clock", "has_accel", "has_temperature", "firmware"),
    [
        ("nano-33-ble", 119.0, False, False, False, ""),
        ("icm-20948-sparkfun", 31.0, False, True, True, ""),
        ("openlog-artemis", 100.0, True, True, True, "2.8"),
        ("razor-m0", 100.0, True, True, False, ""),
        ("adafruit-raw", 80.0, False, True, False, ""),
    ],
)
def test_who_a_device_is(
    name: str, rate_hz: float, has_clock: bool, has_accel: bool, has_temperature: bool, firmware: str
) -> None:
    (who,) = identities(read(name, PRINTED[name][0](60))[0])
    assert who.rate_hz == pytest.approx(rate_hz)
    assert (who.has_clock, who.has_accel, who.has_temperature) == (has_clock, has_accel, has_temperature)
    assert who.firmware == firmware
    assert who.gyro_range > 0


@pytest.mark.parametrize("name", [name for name in NAMES if name != "razor-m0"])
def test_a_banner_is_a_boot_also_after_half_a_row(name: str) -> None:
    prints = PRINTED[name][0]
    torn = prints(41, False)
    torn = torn[: torn.rindex(b"\r\n", 0, -2) + 15]  # cut within its last line
    events, faults = read(name, prints(40) + torn + prints(40))
    first, second = identities(events)
    assert first.boot != second.boot
    assert second.boot_cause is BootCause.POWER_UP
    assert faults == {"line_cut": 1}


def test_the_razor_s_boot_is_its_clock_s() -> None:
    events, faults = read("razor-m0", printed.razor(50, first_ms=90_000) + printed.razor(50, first_ms=800))
    assert [who.boot_cause for who in identities(events)] == [BootCause.PORT_OPENED, BootCause.POWER_UP]
    assert faults == {"odd_time": 2}


def test_an_artemis_without_its_header_is_not_guessed_at() -> None:
    events, faults = read("openlog-artemis", printed.artemis(30, start=False))
    assert (events, faults) == ([], {"no_header": 30})


def test_a_header_without_the_gyro_stops_the_rows() -> None:
    stopped = b"rtcDate,rtcTime,aX,aY,aZ,output_Hz,\r\n01/01/2025,10:00:00.00,1.00,2.00,3.00,10.0,\r\n"
    events, faults = read("openlog-artemis", printed.artemis(40) + stopped)
    assert faults == {"header_incomplete": 1, "no_header": 1}
    assert len(gyro(events)) == 40


def test_an_artemis_without_microseconds_says_that_its_time_is_a_count() -> None:
    one = decoder("openlog-artemis")
    events = one.feed(b"\n" + printed.artemis(20, micros=False), 0)
    (notice,) = [event for event in events if isinstance(event, Notice)]
    assert notice.name == "no_clock"
    assert notice.said == Code.NO_TIME_COLUMN(column="'micros'", rate_hz="10")
    (who,) = identities(events)
    assert (who.has_clock, who.rate_hz, who.boot_cause) == (False, 10.0, BootCause.POWER_UP)
    later = one.feed(printed.artemis(40), 0)
    assert Notice("no_clock", None) in later
    assert identities(later)[-1].has_clock


def test_a_known_wrong_sensitivity_is_said_and_not_put_right() -> None:
    events, _ = read("nano-33-ble", printed.nano(3))
    (notice,) = [event for event in events if isinstance(event, Notice)]
    assert notice.name == "known_scale_fault"
    assert notice.said is not None
    assert (notice.said.code, notice.said.params["percent"], notice.said.params["scale"]) == (
        Code.READS_LOW, "12.8", "1.147",
    )  # fmt: skip
    assert gyro(events)[0, 0] == pytest.approx(1.5)


@pytest.mark.parametrize("name", NAMES)
def test_a_port_opened_anywhere_gives_no_wrong_sample(name: str) -> None:
    """Half a row can look like a whole one: `2.50` for `12.50`."""
    prints, _, step = PRINTED[name]
    stream, wanted = prints(4, False), np.array([printed.turn(i) for i in range(4)])
    for cut in range(len(stream)):
        one = decoder(name)
        one.feed(b"\n" + prints(0), 0)
        one.opened()
        events = one.feed(stream[cut:], 0) + one.finish()
        assert one.faults.total() == (stream[cut] not in b"\r\n")
        rows = gyro(events)
        assert len(rows) == len(gyro(read(name, prints(0) + stream[cut:].partition(b"\n")[2])[0]))
        assert np.allclose(rows, wanted[4 - len(rows) :], atol=1.001 * step)
