"""What a profile may say, what it is refused for, and what its rows become."""

import math
from pathlib import Path

import numpy as np
import pytest

from bridge.drivers.driver import Battery, Identity, Readings
from bridge.drivers.text_profile import KIND, TextDecoder, TextOptions
from bridge.text.profile import Profile, load_profile
from bridge.toml.loader import ConfigError, options

GOOD = """
summary = "s"
[device]
model = "m"
rate_hz = 50
[csv]
columns = ["t", "gx", "gy", "gz", "ax", "ay", "az", "c"]
[gyro]
columns = ["gx", "gy", "gz"]
unit = "dps"
"""


def profile(tmp_path: Path, text: str) -> Profile:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_profile(path)


def samples(of: Profile, text: str, rate_hz: float = 0.0) -> tuple[list[Readings], dict[str, int]]:
    decoder = TextDecoder(of, rate_hz)
    events = decoder.feed(f"\n{text}\n".encode(), 0) + decoder.finish()
    return [event for event in events if isinstance(event, Readings)], decoder.faults.as_dict()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("unit = ", "unti = "), r"\[gyro\]: unknown key 'unti'; did you mean 'unit'?"),
        (('"dps"', '"dsp"'), r"\[gyro\]: unknown unit 'dsp'; there are counts, deg/h, deg/s"),
        (
            ('["gx", "gy", "gz"]\nunit', '["gx", "gy", "gq"]\nunit'),
            r"\[gyro\]: unknown column 'gq'; there are .*gx, gy, gz",
        ),
        (('["gx", "gy", "gz"]\nunit', '["gx", "gy", "gy"]\nunit'), r"\[gyro\]: column 'gy' is already used"),
        (('["gx", "gy", "gz"]\nunit', '["gx", "gy"]\nunit'), r"\[gyro\]: key 'columns': .*length 3"),
        (("[gyro]", "[gyrp]"), "unknown key 'gyrp'; did you mean 'gyro'"),
        (("[device]", "[devise]"), "unknown key 'devise'; did you mean 'device'"),
        (('"dps"', '"counts"'), r"\[gyro\]: unit 'counts' needs sensitivity_mdps"),
        (('"dps"', '"dps"\nsensitivity_mdps = 8.75'), "sensitivity_mdps applies only to unit = 'counts'"),
        (('"dps"', '"dps"\nscale = [1, 0, 1]'), "scale is"),
        (('"dps"', '"dps"\n[accel]\ncolumns = ["ax", "ay", "gz"]\nunit = "g"'), r"'gz' is already used by \[gyro\]"),
        (('"dps"', '"dps"\n[time]\ncolumn = "t"\nunit = "min"'), r"\[time\]: unknown unit 'min'; .*ms"),
        (('"dps"', '"dps"\n[time]\ncolumn = "t"\nunit = "ms"\nbits = 3'), r"\[time\]: bits is 3"),
        (('"dps"', '"dps"\n[temperature]\ncolumn = "t"\nscale = nan'), r"\[temperature\]: scale is nan"),
        (('"dps"', '"dps"\n[temperature]\ncolumn = "t"\noffset_c = inf'), r"\[temperature\]: offset_c is inf"),
        (('"dps"', '"dps"\n[regex]\nmatch = "(?P<gx>.)"'), "exactly one of these tables"),
        (("[device]", "banners = ['(']\n[device]"), r"banners: '\(' is not a regular expression"),
        (
            ("[device]", "banners = ['v(?P<firmwear>.*)']\n[device]"),
            "unknown group 'firmwear'; did you mean 'firmware'",
        ),
        (("columns = [", 'separator = ".."\ncolumns = ['), r"\[csv\]: separator is '..'"),
        (("[csv]", "[csv]\nheader = true\n[csvv]"), "unknown key 'csvv'"),
        (("rate_hz = 50", "rate_hz = -1"), r"\[device\]: rate_hz is -1"),
        (('model = "m"', ""), r"\[device\]: the key 'model' is missing"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    assert change[0] in GOOD
    with pytest.raises(ConfigError, match=rf"mine\.toml: .*{said}"):
        profile(tmp_path, GOOD.replace(*change))


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="unknown profile 'nano33ble'; did you mean 'nano-33-ble'"):
        load_profile("nano33ble")


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ('"rad/s"', 2.0),
        ('"mrad/s"', 0.002),
        ('"dps"', math.radians(2)),
        ('"mdps"', math.radians(0.002)),
        ('"counts"\nsensitivity_mdps = 70', math.radians(0.14)),
        ('"dps"\nscale = -3', math.radians(-6)),
    ],
)
def test_units_of_rates(tmp_path: Path, unit: str, expected: float) -> None:
    ((readings,), faults) = samples(profile(tmp_path, GOOD.replace('"dps"', unit)), "1,2,2,2,0,0,0,0")
    assert faults == {}
    assert readings.gyro == pytest.approx(np.full((1, 3), expected))
    assert readings.accel is None


@pytest.mark.parametrize(
    ("unit", "expected"),
    [('"m/s2"', 2.0), ('"g"', 19.6133), ('"mg"', 0.0196133), ('"counts"\nsensitivity_mg = 0.061', 0.00119641)],
)
def test_units_of_accelerations_and_axes(tmp_path: Path, unit: str, expected: float) -> None:
    text = GOOD + f'[accel]\ncolumns = ["ay", "ax", "az"]\nscale = [1, -1, 0.5]\nunit = {unit}\n'
    text += '[temperature]\ncolumn = "c"\nscale = 0.01\noffset_c = 20'
    ((readings,), _) = samples(profile(tmp_path, text), "1,2,2,2,-2,2,2,350")
    assert readings.accel == pytest.approx(np.array([[expected, expected, expected / 2]]), rel=1e-5)
    assert readings.temperature_c == pytest.approx([23.5])


@pytest.mark.parametrize(
    ("time", "sent", "seconds"),
    [
        ('unit = "ms"', ["5000", "5020.0"], 0.02),
        ('unit = "us"', ["4294967290", "10"], 16e-6),
        ('unit = "ms"\nbits = 16', ["65530", "4"], 0.01),
        ('unit = "s"', ["12.5", "12.52"], 0.02),
        ('unit = "ms"\nbits = 0', ["5000.25", "5020.75"], 0.0205),
    ],
)
def test_times(tmp_path: Path, time: str, sent: list[str], seconds: float) -> None:
    of = profile(tmp_path, GOOD + f'[time]\ncolumn = "t"\n{time}')
    rows = "\n".join(f"{text},1,2,3,0,0,0,0" for text in sent)
    decoder = TextDecoder(of)
    who, *events = decoder.feed(f"\n{rows}\n".encode(), 0) + decoder.finish()
    assert isinstance(who, Identity)
    ticks = [tick for event in events if isinstance(event, Readings) for tick in event.ticks.tolist()]
    assert decoder.faults.as_dict() == {}
    assert (ticks[1] - ticks[0]) * who.tick_period_s == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        ("1,2,3,4,5,6,7", "row_short"),
        ("1,2,3,4,5,6,7,", "row_short"),
        ("1,2,3,4,5,6,7,8,9", "row_long"),
        ("1,2,3,,5,6,7,8", "not_a_number"),
        ("1,nan,3,4,5,6,7,8", "not_a_number"),
        ("1,inf,3,4,5,6,7,8", "not_a_number"),
        ("1,1e999,3,4,5,6,7,8", "not_a_number"),
        ("1,1_0,3,4,5,6,7,8", "not_a_number"),
        ("1,0x10,3,4,5,6,7,8", "not_a_number"),
        ("1,2.1.3,3,4,5,6,7,8", "not_a_number"),
        ("1,١,3,4,5,6,7,8", "not_a_number"),
        ("-1,2,3,4,5,6,7,8", "not_a_number"),
        ("4294967296,2,3,4,5,6,7,8", "not_a_number"),
        ("1.5,2,3,4,5,6,7,8", "not_a_number"),
        ("1,2,3,4,5,6,7,8" + " " * 2000 + ",", "line_too_long"),
    ],
)
def test_a_row_that_is_not_whole_is_refused_under_its_reason(tmp_path: Path, row: str, fault: str) -> None:
    of = profile(tmp_path, GOOD + '[time]\ncolumn = "t"\nunit = "ms"')
    readings, faults = samples(of, row)
    assert readings == []
    assert faults == {fault: 1}
    assert samples(of, "1,+2,.3,4.,5,6e-1,7,rest")[1] == {}


def test_a_header_row_says_the_order_whenever_it_comes(tmp_path: Path) -> None:
    of = profile(tmp_path, GOOD.replace("[csv]", "[csv]\nheader = true"))
    readings, faults = samples(of, "0,1,2,3,0,0,0,0\ngz,gy,gx\n3,2,1\n0,1,2,3,0,0,0,0")
    assert np.degrees(np.concatenate([run.gyro for run in readings])) == pytest.approx(np.array([[1, 2, 3]] * 2))
    assert faults == {"row_long": 1}


def test_a_pattern_s_columns_may_be_missing_but_not_the_gyro_s(tmp_path: Path) -> None:
    text = GOOD[: GOOD.index("[csv]")] + GOOD[GOOD.index("[gyro]") :]
    text += "[regex]\nmatch = 'G (?P<gx>\\S+) (?P<gy>\\S+)( (?P<gz>\\S+))?( A (?P<a>\\S+) (?P<b>\\S+) (?P<c>\\S+))?'\n"
    text += '[accel]\ncolumns = ["a", "b", "c"]\nunit = "g"'
    of = profile(tmp_path, text)
    readings, faults = samples(of, "G 1 2 3\nG 1 2 3 A 0 0 1\nG 1 2\nH 1 2 3\nG 1 2 3 A 0 0 z")
    assert [run.accel is None for run in readings] == [True, False]
    assert faults == {"no_match": 2, "not_a_number": 1}


def test_blanks_may_separate(tmp_path: Path) -> None:
    of = profile(tmp_path, GOOD.replace("[csv]", '[csv]\nseparator = " "'))
    assert samples(of, "  0  1 2\t 3 0 0 0 0")[0][0].gyro == pytest.approx(np.radians([[1, 2, 3]]))


def test_numbers_with_a_decimal_comma_and_a_time_in_nanoseconds_are_read(tmp_path: Path) -> None:
    text = 'decimal = ","\n' + GOOD.replace("[csv]", '[csv]\nseparator = ";"') + '[time]\ncolumn = "t"\nunit = "ns"'
    rows = [f"{1_764_300_000_000_000_000 + 20_000_000 * i};1,5;-2,25;,5;0;0;0;0" for i in range(60)]
    decoder = TextDecoder(profile(tmp_path, text), captured=True)
    events = decoder.feed("\n".join([*rows, rows[0].replace("1,5", "1.5"), ""]).encode(), 0) + decoder.finish()
    readings = [event for event in events if isinstance(event, Readings)]
    assert np.degrees(np.concatenate([run.gyro for run in readings])) == pytest.approx(
        np.tile([1.5, -2.25, 0.5], (60, 1))
    )
    [identity] = [event for event in events if isinstance(event, Identity)]
    assert identity.rate_hz == pytest.approx(50)
    assert decoder.faults.as_dict() == {"not_a_number": 1}
    with pytest.raises(ConfigError, match="decimal and separator are both ','"):
        profile(tmp_path, 'decimal = ","\n' + GOOD)


def test_the_ward_s_file_says_what_the_profile_leaves_open(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="rate_hz is missing: devices of profile 'icm-20948-sparkfun' send no time"):
        options({"port": "/dev/x", "profile": "icm-20948-sparkfun"}, TextOptions)
    with pytest.raises(ValueError, match="unknown profile 'nano'"):
        options({"port": "/dev/x", "profile": "nano"}, TextOptions)
    given = options({"port": "/dev/x", "profile": "nano-33-ble", "gyro_range_dps": 500}, TextOptions)
    assert given.baud == 9600
    assert options({"port": "/dev/x", "profile": "nano-33-ble", "baud": 115200}, TextOptions).baud == 115200
    assert KIND.make(given).place == "/dev/x"


def test_a_battery_column_is_told_when_it_changes(tmp_path: Path) -> None:
    text = GOOD.replace('["t"', '["bat"') + '[battery]\ncolumn = "bat"\nscale = 0.1\n'
    decoder = TextDecoder(profile(tmp_path, text))
    lines = [f"{bat},1,2,3,0,0,0,0" for bat in ("815", "815", "", "810", "1020")]
    events = decoder.feed(("\n" + "\n".join(lines) + "\n").encode(), 0) + decoder.finish()
    assert [event.percent for event in events if isinstance(event, Battery)] == [81.5, 81.0, 100.0]
    assert sum(len(event.ticks) for event in events if isinstance(event, Readings)) == 5, "no sample is lost by it"
