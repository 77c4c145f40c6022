"""The recordings of `../shared/data/field`, one kind of fault a folder, give what their README expects."""

from pathlib import Path

import numpy as np
import pytest

from bridge.drivers.capture import load_capture
from bridge.recording import Reading, load
from estimator.cli.main import main
from estimator.offline.recordings import calibrate
from tests.bridge.recording.text.session import refusal, right

FIELD = Path(__file__).parents[4].parent / "shared" / "data" / "field"
pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not FIELD.is_dir(), reason=f"the recordings of the field are not in {FIELD}"),
]
DPS = Reading(gyro_unit="deg/s")
AT_50 = Reading(rate_hz=50.0)
#: the one option, beside a rate, that a file of folder 01 needs; the message names it
TOOLS = {
    "arduino_counts.csv": ("--gyro-sensitivity", Reading(gyro_sensitivity=131.0)),
    "arduino_t_ax_gx.csv": ("--gyro-unit deg/s", DPS),
    "gnss_ins_sim_gyro.csv": ("--rate-hz", AT_50),
    "imucal_example.csv": ("--gyro-unit deg/s", Reading(gyro_unit="deg/s", rate_hz=50.0)),
}


def test_01_exports_of_known_tools() -> None:
    for path in sorted((FIELD / "01-exports-of-known-tools").glob("*.*")):
        if path.suffix == ".md":
            continue
        reading = None
        if path.name in TOOLS:
            option, reading = TOOLS[path.name]
            assert option in refusal(path)
        right(path, reading)


@pytest.mark.parametrize(
    ("name", "reading", "said"),
    [
        ("02-times-of-arrival-in-bunches/ble_three_at_a_time.csv", None, "arrival times, in bursts"),
        ("02-times-of-arrival-in-bunches/ble_three_at_a_time_100hz.csv", None, "arrival times, in bursts"),
        ("03-rows-that-came-twice/twice.csv", None, "26 rows left out: equal to an earlier row, including the time"),
        ("03-rows-that-came-twice/twice_without_times.csv", AT_50, "26 rows left out: equal to an earlier row"),
        ("03-rows-that-came-twice/sent_again_without_times.csv", AT_50, "18 rows left out: equal to an earlier row"),
        ("04-clocks-that-do-not-rise/ms_at_1125_hz.csv", None, "the clock is coarse"),
        ("04-clocks-that-do-not-rise/ns.csv", None, ""),
        ("04-clocks-that-do-not-rise/ns_called_us.csv", Reading(time_unit="ns"), ""),
        ("04-clocks-that-do-not-rise/one_bad.csv", None, "1 bad time"),
        ("04-clocks-that-do-not-rise/sci_notation.csv", AT_50, "the times are rounded"),
        ("04-clocks-that-do-not-rise/wraps_at_32_bits.csv", None, "the counter wrapped 1 time"),
        ("07-accelerometer-in-another-unit/m_s2_called_g.csv", None, "--accel-unit m/s2"),
        ("07-accelerometer-in-another-unit/m_s2_called_g.csv", Reading(accel_unit="m/s2"), ""),
        ("07-accelerometer-in-another-unit/counts_called_m_s2.csv", None, "--accel-sensitivity"),
        ("07-accelerometer-in-another-unit/counts_called_m_s2.csv", Reading(accel_sensitivity=2048.0), ""),
        ("12-rows-beside-the-rows/a_few_nan.csv", None, "3 rows left out"),
        ("12-rows-beside-the-rows/comma_at_the_end.csv", None, ""),
        ("12-rows-beside-the-rows/comments.csv", None, ""),
        ("12-rows-beside-the-rows/cut_last_line.csv", None, "1 line left out"),
        ("12-rows-beside-the-rows/header_again.csv", None, "1 line left out"),
        ("12-rows-beside-the-rows/sep_line.csv", None, ""),
    ],
)
def test_what_can_be_mended_is_right(name: str, reading: Reading | None, said: str) -> None:
    assert said in right(FIELD / name, reading)


def test_04_a_reboot_is_said_to_be_one() -> None:
    path = FIELD / "04-clocks-that-do-not-rise" / "rebooted.csv"
    assert "choose one with --boot: 1 (700 samples), 2 (620 samples)" in refusal(path)
    assert "the rebooted device" in refusal(path, AT_50)
    assert len(load(path, boot=1)) == 700


def test_05_the_first_line_of_a_file_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    path = FIELD / "05-header-in-the-first-line-of-a-log" / "dataLog00001.TXT"
    assert main(["recording", "inspect", str(path), "--profile", "openlog-artemis"]) == 0
    assert "300 in 5.980 s" in capsys.readouterr().out
    assert len(load(path)) == len(load_capture(path, "", "openlog-artemis", Reading())) == 300


@pytest.mark.parametrize(
    ("name", "driver", "hz", "samples"),
    [
        ("06-witmotion-28-byte-frames/wt901sdcl-bt50.bin", "witmotion", 50.0, 498),
        ("09-mtdata2-without-rate-of-turn/delta_q_only.bin", "mtdata2", 100.0, 597),
    ],
)
def test_06_and_09_captures_are_decoded(name: str, driver: str, hz: float, samples: int) -> None:
    recording = load_capture(FIELD / name, driver, "", Reading())
    assert len(recording) >= samples
    assert recording.rate_hz == pytest.approx(hz)
    assert recording.accel is not None
    assert np.median(np.linalg.norm(recording.accel, axis=1)) == pytest.approx(9.8, abs=0.1)


def test_08_no_unit_is_guessed_and_a_wrong_one_is_doubted() -> None:
    folder = FIELD / "08-hint-names-a-unit-nobody-said"
    said = refusal(folder / "unit_not_said_rad_s.csv")
    assert "--gyro-unit deg/s or --gyro-unit rad/s" in said
    assert not load(folder / "unit_not_said_rad_s.csv", reading=Reading(gyro_unit="rad/s")).notes
    assert "less than any MEMS gyro's" in "; ".join(load(folder / "as_the_hint_says.csv").notes)


def test_10_a_capture_is_converted_and_calibrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = FIELD / "10-a-capture-cannot-be-worked-on" / "wit_sd.txt", tmp_path / "out.npz"
    assert "truerate recording convert" in refusal(path)
    assert main(["recording", "convert", str(path), str(out), "--driver", "witmotion"]) == 1
    assert "give the device's output data rate with --rate-hz" in capsys.readouterr().err
    assert main(["recording", "convert", str(path), str(out), "--driver", "witmotion", "--rate-hz", "50"]) == 0
    right(out)


def test_11_a_gyro_that_corrects_itself_and_a_dead_axis_are_said() -> None:
    folder = FIELD / "11-a-gyro-that-zeroes-itself"
    assert "the device corrects itself at rest" in "; ".join(load(folder / "zero_at_rest.csv").notes)
    stuck = load(folder / "x_stuck.csv")
    assert "x of the gyro never changes" in "; ".join(stuck.notes)
    assert calibrate(stuck)[0].verdict.name != "ACCEPTED"
