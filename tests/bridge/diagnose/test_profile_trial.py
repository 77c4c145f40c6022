"""`truerate bridge profiles` and `truerate bridge try`: what somebody who adds a device is told."""

from pathlib import Path

import pytest

from estimator.cli.main import main
from tests.bridge.text import printed


def test_the_profiles_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bridge", "profiles"]) == 0
    assert "nano-33-ble Arduino Nano 33 BLE (LSM9DS1)" in " ".join(capsys.readouterr().out.split())


def test_a_capture_is_tried(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = tmp_path / "capture.txt"
    capture.write_bytes(b"18\t-0.31\r\n" + printed.nano(238) + b"1.22\t0.18\r\n1.22\t0.18\t-0.3x\r\n1.2")
    assert main(["bridge", "try", "nano-33-ble", str(capture), "--seconds", "2"]) == 0
    said = capsys.readouterr().out
    for words in [
        "understood: 238 samples in 1 boot",
        "rate:       119 Hz, as given: the lines carry no time",
        "counted:    119 samples a second in 2 s",
        "reads 12.8 % low",
        "1.500     -0.000     -3.000",
        "line 1: '18\\t-0.31': 2 columns found, 3 expected",
        "line 245: '1.22\\t0.18': 2 columns found, 3 expected",
        "line 246: '1.22\\t0.18\\t-0.3x': '-0.3x' is not a number",
    ]:
        assert words in said


def test_a_rate_that_nobody_knows_is_not_made_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = tmp_path / "capture.txt"
    capture.write_bytes(printed.icm(10))
    assert main(["bridge", "try", "icm-20948-sparkfun", str(capture)]) == 0
    assert "rate:       unknown: the lines carry no time" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("came", "words"),
    [
        (b"", "0 bytes, all blank: the device printed nothing"),
        (b"\r\n" * 9, "18 bytes, all blank"),
        (b"hello\nworld\n", "12 bytes in 2 lines, but no sample: try another profile"),
        (bytes(range(128, 256)), "128 bytes in"),
        (bytes(range(128, 256)), "the speed was probably wrong"),
    ],
)
def test_of_a_capture_without_a_sample_it_is_said_what_came_and_what_to_do(
    came: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = tmp_path / "capture.txt"
    capture.write_bytes(came)
    assert main(["bridge", "try", "nano-33-ble", str(capture)]) == 1
    assert words in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--seconds", "--rate-hz"])
@pytest.mark.parametrize("given", ["0", "-3", "nan", "inf"])
def test_no_time_and_no_rate_are_refused(
    option: str, given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bridge", "try", "nano-33-ble", str(tmp_path), f"{option}={given}"]) == 2
    assert f"{option} is {given}: use a number above 0" in capsys.readouterr().err


def test_what_is_not_understood_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = tmp_path / "capture.txt"
    capture.write_bytes(b"\n" + printed.nano(3))
    assert main(["bridge", "try", "razor-m0", str(capture)]) == 1
    assert main(["bridge", "try", "razor", str(capture)]) == 2
    assert "did you mean 'razor-m0'" in capsys.readouterr().err


@pytest.mark.parametrize("pause_ms", [3000, 60_000])
def test_a_pause_in_a_capture_is_no_boot(pause_ms: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = tmp_path / "capture.txt"
    capture.write_bytes(b"\n" + printed.razor(150) + printed.razor(150, first_ms=2700 + pause_ms))
    assert main(["bridge", "try", "razor-m0", str(capture)]) == 0
    assert "understood: 300 samples in 1 boot\n" in capsys.readouterr().out
