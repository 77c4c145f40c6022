"""Captures of what devices send become recordings, without a ward: bytes by a driver, lines by a profile."""

import struct
from pathlib import Path

import numpy as np
import pytest

from bridge.drivers.capture import load_capture
from bridge.drivers.driver import Notice
from bridge.drivers.mtdata2 import MtData2Decoder
from bridge.framing import mtdata2
from bridge.reasons.codes import Code
from bridge.recording import Reading, RecordingError
from estimator.cli.main import main
from tests.bridge.recording.text.session import G, turns
from tests.bridge.text import printed

TIME, GYRO, ACCEL = turns()
GYRO_COUNTS = np.rint(GYRO / 2000 * 32768).astype(int)
ACCEL_COUNTS = np.rint(ACCEL / 16 * 32768).astype(int)


def captured(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def witmotion(kind: int, words: list[int]) -> bytes:
    frame = bytes((0x55, kind)) + struct.pack("<4h", *words)
    return frame + bytes((sum(frame) & 0xFF,))


def test_the_profiles_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bridge", "profiles"]) == 0
    assert "openlog-artemis" in capsys.readouterr().out


def test_serial_witmotion_tells_no_time_and_loses_no_sample(tmp_path: Path) -> None:
    rows = zip(ACCEL_COUNTS.tolist(), GYRO_COUNTS.tolist(), strict=True)
    data = b"".join(witmotion(0x51, [*a, 2500]) + witmotion(0x52, [*g, 2500]) for a, g in rows)
    path = captured(tmp_path / "sd.txt", data)
    with pytest.raises(RecordingError, match="carry no time: give the device's output data rate with --rate-hz"):
        load_capture(path, "witmotion", "", Reading())
    recording = load_capture(path, "witmotion", "", Reading(rate_hz=50.0))
    assert len(recording) == len(TIME)
    assert np.allclose(recording.time_s, TIME)
    assert np.allclose(np.degrees(recording.gyro), GYRO, atol=0.04)
    assert recording.accel is not None
    assert np.allclose(recording.accel, ACCEL * G, atol=0.01)


def test_witmotion_frames_with_a_date_tell_their_time(tmp_path: Path) -> None:
    def frame(ms: int, accel: list[int], gyro: list[int]) -> bytes:
        clock = bytes((26, 6, 22, 14, 41 + ms // 60_000, ms // 1000 % 60)) + (ms % 1000).to_bytes(2, "little")
        return b"\x55\x61" + struct.pack("<9h", *accel, *gyro, 0, 0, 0) + clock

    rows = zip((TIME * 1000).round().astype(int).tolist(), ACCEL_COUNTS.tolist(), GYRO_COUNTS.tolist(), strict=True)
    recording = load_capture(
        captured(tmp_path / "a.bin", b"".join(frame(*row) for row in rows)), "witmotion", "", Reading()
    )
    assert len(recording) >= len(TIME) - 3
    assert recording.rate_hz == pytest.approx(50.0)
    assert np.allclose(np.degrees(recording.gyro[-100:]), GYRO[-100:], atol=0.04)


def delta_message(counter: int, ticks: int, turned: list[float], sped: list[float]) -> bytes:
    angle = float(np.linalg.norm(turned))
    vector = [float(np.sin(angle / 2) * part / angle) if angle else 0.0 for part in turned]
    items = struct.pack(">HBH", 0x1020, 2, counter & 0xFFFF) + struct.pack(">HBI", 0x1060, 4, ticks)
    items += struct.pack(">HB4f", 0x8030, 16, np.cos(angle / 2), *vector) + struct.pack(">HB3f", 0x4010, 12, *sped)
    return mtdata2.encode(mtdata2.MTDATA2, items)


def test_mtdata2_with_rotations_alone_gives_rates(tmp_path: Path) -> None:
    data = b"".join(
        delta_message(i, 200 * i, (np.radians(g) / 50).tolist(), (a * G / 50).tolist())
        for i, (g, a) in enumerate(zip(GYRO, ACCEL, strict=True))
        if i != 500
    )
    recording = load_capture(captured(tmp_path / "a.bin", data), "mtdata2", "", Reading())
    assert len(recording) >= len(TIME) - 5
    assert recording.rate_hz == pytest.approx(50.0)
    assert recording.sequence[-1] - len(recording) + 1 == 1
    assert np.allclose(np.degrees(recording.gyro[-100:]), GYRO[-100:], atol=1e-3)
    assert recording.accel is not None
    assert np.allclose(recording.accel[-100:], ACCEL[-100:] * G, atol=1e-3)


def test_legacy_mtdata_is_named() -> None:
    events = MtData2Decoder().feed(mtdata2.encode(mtdata2.MTDATA, bytes(36)), 0)
    assert any(isinstance(event, Notice) and event.said == Code.LEGACY_MTDATA() for event in events)


def test_the_first_line_of_a_log_is_whole(tmp_path: Path) -> None:
    lines = ["micros,aX,aY,aZ,gX,gY,gZ,imu_degC,"]
    rows = zip(TIME, ACCEL * 1000, GYRO, strict=True)
    lines += [",".join([f"{t * 1e6:.0f}", *(f"{v:.2f}" for v in (*a, *g)), "25.0", ""]) for t, a, g in rows]
    path = captured(tmp_path / "dataLog.TXT", "\r\n".join(lines).encode() + b"\r\n")
    recording = load_capture(path, "", "openlog-artemis", Reading())
    assert len(recording) == len(TIME)
    assert np.allclose(np.degrees(recording.gyro), GYRO, atol=0.006)


def test_refused_lines_and_the_notices_of_a_profile_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = b"18\t-0.31\r\n" + printed.nano(238) + b"1.22\t0.18\r\n1.22\t0.18\t-0.3x\r\n1.2"
    path = captured(tmp_path / "capture.txt", data)
    words = ["recording", "inspect", str(path), "--profile"]
    assert main([*words, "nano-33-ble"]) == 0
    said = capsys.readouterr().out
    assert "samples:     238 in" in said
    assert "reads 12.8 % low" in said
    assert "2 row short ('18\\t-0.31': 2 columns found, 3 expected)" in said
    assert "1 not a number ('1.22\\t0.18\\t-0.3x': '-0.3x' is not a number)" in said
    assert main([*words, "razor-m0"]) == 1
    assert "no sample found by razor-m0" in capsys.readouterr().err
    assert main([*words, "razor"]) == 2
    assert "did you mean 'razor-m0'" in capsys.readouterr().err


def test_samples_without_time_or_rate_are_counted(tmp_path: Path) -> None:
    path = captured(tmp_path / "capture.txt", printed.icm(10))
    with pytest.raises(RecordingError, match="its 10 samples carry no time"):
        load_capture(path, "", "icm-20948-sparkfun", Reading())


@pytest.mark.parametrize("pause_ms", [3000, 60_000])
def test_a_pause_in_a_capture_is_no_boot(pause_ms: int, tmp_path: Path) -> None:
    data = b"\n" + printed.razor(150) + printed.razor(150, first_ms=2700 + pause_ms)
    assert len(load_capture(captured(tmp_path / "capture.txt", data), "", "razor-m0", Reading())) == 300
