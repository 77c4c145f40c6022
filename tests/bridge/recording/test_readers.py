"""A recording is whole, finite and in order, or refused with its file, key and sample."""

import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import MAX_BYTES, Recording, RecordingError, load
from bridge.recording.recover import recover
from bridge.recording.survey import survey

DATA = Path(__file__).parents[3].parent / "shared" / "data"


def saved(tmp_path: Path, **arrays: Any) -> Path:
    path = tmp_path / "rec.npz"
    np.savez(path, **arrays)
    return path


def refusal(path: Path, **kwargs: Any) -> str:
    with pytest.raises(RecordingError) as refused:
        load(path, **kwargs)
    assert str(refused.value).startswith(str(path))
    return str(refused.value)


GYRO = np.arange(12.0).reshape(4, 3)


def test_an_npz_with_a_rate_is_evenly_spaced(tmp_path: Path) -> None:
    recording = load(saved(tmp_path, gyro_rad_s=GYRO, rate_hz=100.0, arrival_s=np.array([0.0, 0, 9, 9])))
    assert np.allclose(recording.time_s, [0, 0.01, 0.02, 0.03])  # arrival_s is never the time of a sample
    assert (recording.rate_hz, recording.name, recording.accel) == (100.0, "rec", None)
    assert np.array_equal(recording.gyro, GYRO)


def test_an_npz_with_times_has_the_median_rate(tmp_path: Path) -> None:
    recording = load(saved(tmp_path, gyro_rad_s=GYRO, t_s=[5, 5.02, 5.04, 9]))
    assert np.allclose(recording.time_s, [0, 0.02, 0.04, 4])
    assert recording.rate_hz == pytest.approx(50)


@pytest.mark.parametrize(("hz", "tick_s"), [(833, 1e-3), (416, 1e-3), (104, 1e-3), (80, 1e-2), (75, 1e-2), (100, 1e-6)])
def test_coarsely_rounded_times_have_the_rate_that_they_were_sampled_at(
    tmp_path: Path, hz: float, tick_s: float
) -> None:
    time = np.rint(np.arange(4000) / hz / tick_s) * tick_s
    for lost in (np.zeros(4000, bool), np.arange(4000) % 500 == 499, (time > 3) & (time < 4)):
        arrays: dict[str, Any] = {"t_s": time[~lost], "gyro_rad_s": np.zeros((np.count_nonzero(~lost), 3))}
        recording = load(saved(tmp_path, **arrays))
        assert recording.rate_hz == pytest.approx(hz, rel=2e-3)
        assert lost.any() or recording.sequence[-1] == 3999


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"rate_hz": 1.0}, "'gyro_rad_s' is missing, found rate_hz"),
        ({"gyro_rad_s": GYRO[:, :2], "rate_hz": 1.0}, "shape (4, 2): give (n, 3)"),
        ({"gyro_rad_s": np.float64(3), "rate_hz": 1.0}, "shape (): give (n, 3)"),
        ({"gyro_rad_s": GYRO, "accel_m_s2": GYRO[:3], "rate_hz": 1.0}, "'accel_m_s2' has shape (3, 3): give (4, 3)"),
        ({"gyro_rad_s": GYRO, "t_s": [1, 2]}, "'t_s' has shape (2,): give (4,)"),
        ({"gyro_rad_s": GYRO, "rate_hz": [1.0]}, "'rate_hz' has shape (1,): give ()"),
        ({"gyro_rad_s": np.where(GYRO == 7, np.nan, GYRO), "rate_hz": 1.0}, "not a finite number at sample 2 (1 such"),
        ({"gyro_rad_s": GYRO, "rate_hz": np.inf}, "'rate_hz' is not a finite number"),
        ({"gyro_rad_s": GYRO, "rate_hz": -5.0}, "the stated rate is -5 Hz: give --rate-hz from 1 to 20000"),
        ({"gyro_rad_s": GYRO[:1], "rate_hz": 1.0}, "1 sample; at least 2"),
        ({"gyro_rad_s": GYRO}, "neither sample times nor 'rate_hz': give the rate with --rate-hz"),
        (
            {"gyro_rad_s": GYRO * 100, "rate_hz": 1.0},
            "is 1100 rad/s at sample 3; at most ±1000 rad/s is possible; if the unit is degrees",
        ),
        ({"gyro_rad_s": GYRO * -1e300, "rate_hz": 1.0}, "is -1e+300 rad/s at sample 0"),
        ({"gyro_rad_s": GYRO, "t_s": [0, 1, 2, 1e300]}, "'t_s' is 1e+300 s at sample 3; at most ±1e+10 s"),
        ({"gyro_rad_s": GYRO.astype(str), "rate_hz": 1.0}, "numbers are needed"),
        ({"gyro_rad_s": GYRO.astype(object), "rate_hz": 1.0}, "or with arrays that are not plain numbers"),
    ],
)
def test_a_bad_npz_is_refused(tmp_path: Path, arrays: dict[str, Any], said: str) -> None:
    assert said in refusal(saved(tmp_path, **arrays))


def test_an_archive_that_unpacks_to_too_much_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("gyro_rad_s.npy", "w") as member:
        for _ in range(MAX_BYTES >> 24):
            member.write(bytes(1 << 24))
        member.write(b"\0")
    assert path.stat().st_size < 1 << 20
    assert f"the file unpacks to {MAX_BYTES + 1} bytes" in refusal(path)


def test_nobody_is_advised_to_load_unsafely(tmp_path: Path) -> None:
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps([1]))
    np.save(tmp_path / "one.npy", GYRO.astype(object))
    (tmp_path / "one.npy").rename(tmp_path / "one.npz")
    objects = saved(tmp_path, gyro_rad_s=GYRO.astype(object))
    for path in (tmp_path / "pickle.npz", tmp_path / "one.npz", objects):
        assert "pickle" not in refusal(path).removeprefix(str(path))


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.npz").write_bytes(b"PK\x03\x04 no archive")
    (tmp_path / "y.npz").write_bytes(b"\x80\x04N.")
    (tmp_path / "z.wav").write_bytes(b"")
    assert "not a readable" in refusal(tmp_path / "x.npz")
    assert "not a readable" in refusal(tmp_path / "y.npz")
    assert "give a recording in .npz, .mcap, .bag" in refusal(tmp_path / "z.wav")
    assert "cannot be read: there is no such file" in refusal(tmp_path / "none.npz")


@pytest.mark.parametrize("ending", ["npz", "csv", "mcap"])
def test_what_is_no_file_is_named_and_never_waited_for(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"folder.{ending}").mkdir()
    os.mkfifo(tmp_path / f"pipe.{ending}")
    (tmp_path / f"empty.{ending}").touch()
    assert "a folder, but neither a ROS 2 bag" in refusal(tmp_path / f"folder.{ending}")
    assert "cannot be read: not a file" in refusal(tmp_path / f"pipe.{ending}")
    assert "the file is empty" in refusal(tmp_path / f"empty.{ending}")
    with pytest.raises(RecordingError, match="cannot be read: not a file"):
        survey([tmp_path / f"pipe.{ending}"])
    with pytest.raises(RecordingError, match="cannot be read: not a file"):
        recover(tmp_path / f"pipe.{ending}")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("ending", ["npz", "csv", "mcap"])
def test_a_file_that_may_not_be_read_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"closed.{ending}"
    path.touch(0)
    assert "cannot be read: no permission" in refusal(path)


def test_an_accelerometer_or_thermometer_that_cannot_be_right_is_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = saved(tmp_path, gyro_rad_s=GYRO, accel_m_s2=GYRO * 1e300, temperature_c=[1, 2, 1e300, 4], rate_hz=1.0)
    recording = load(path)
    assert recording.accel is None
    assert recording.temperature_c is None
    assert "the accelerometer is not used: 'accel_m_s2' is 1e+300 m/s² at sample 0" in caplog.text
    assert "the temperature is not used: 'temperature_c' is 1e+300 °C at sample 2" in caplog.text


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real recordings are not in {DATA}")
def test_every_real_recording_loads() -> None:
    for path in sorted(DATA.glob("*/*.npz")):
        recording = load(path)
        assert isinstance(recording, Recording)
        assert 50 < recording.rate_hz < 400
        assert len(recording) > 500


def test_a_rate_in_a_file_that_contradicts_its_times_is_refused_and_a_told_one_replaces_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    times: dict[str, Any] = {"gyro_rad_s": GYRO, "t_s": [0, 0.01, 0.02, 0.03]}
    said = "the times step by 0.01 s (100 Hz), but the file states 400 Hz; give the right rate with --rate-hz"
    path = saved(tmp_path, **times, rate_hz=400.0)
    assert said in refusal(path)
    assert np.allclose(load(path, rate_hz=100.0).time_s, times["t_s"])
    assert "the times are replaced by the given rate, 100 Hz" in caplog.text
    assert load(saved(tmp_path, **times, rate_hz=104.0)).rate_hz == 104.0  # what the device is sold as


def test_a_told_rate_keeps_the_gaps_of_the_times(tmp_path: Path) -> None:
    path = saved(tmp_path, gyro_rad_s=np.ones((6, 3)), t_s=[0, 0.01, 0.02, 0.07, 0.08, 0.09])
    assert np.allclose(load(path, rate_hz=50.0).time_s, np.array([0, 1, 2, 7, 8, 9]) / 50)


def test_a_rate_that_is_told_is_used_and_said_to_be_another(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = saved(tmp_path, gyro_rad_s=GYRO, rate_hz=100.0)
    assert load(path, rate_hz=50.0).rate_hz == 50.0
    assert "the file states 100 Hz; the given 50 Hz is used" in caplog.text


@pytest.mark.parametrize(
    "times",
    [
        pytest.param(np.append(np.arange(10) / 100, 5.0), id="a gap: by their median"),
        pytest.param(np.arange(12) // 2 * 0.02 + np.arange(12) % 2 * 0.002, id="in pairs: by their mean"),
    ],
)
def test_uneven_times_do_not_contradict_a_rate(tmp_path: Path, times: NDArray[np.float64]) -> None:
    assert load(saved(tmp_path, gyro_rad_s=np.ones((len(times), 3)), t_s=times, rate_hz=100.0)).rate_hz == 100.0


@pytest.mark.parametrize(("seconds", "taken"), [(0.2, True), (0.4, False)])
def test_a_blow_is_no_sign_of_degrees(tmp_path: Path, seconds: float, *, taken: bool) -> None:
    gyro = np.where(np.arange(200)[:, None] < seconds * 100, 100.0, 0.1) * [1, 0, 0]
    path = saved(tmp_path, gyro_rad_s=gyro, t_s=np.arange(200) / 100)
    if taken:
        assert len(load(path)) == 200
    else:
        assert "readings of 100 rad/s are probably degrees per second" in refusal(path)


def test_readings_that_nothing_can_be_learnt_of_are_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """They were said never to have been still, or to lie where somebody walks."""
    read = np.random.default_rng(0).normal(size=(500, 3))
    for step_dps in (1e-9, 0.07, 0.2):
        load(saved(tmp_path, gyro_rad_s=np.radians(np.rint(read / step_dps) * step_dps), rate_hz=100.0))
    load(saved(tmp_path, gyro_rad_s=np.zeros((500, 3)), rate_hz=5.0))
    assert not caplog.text
    load(saved(tmp_path, gyro_rad_s=np.radians(np.rint(read)), rate_hz=100.0))
    assert "the readings are rounded to 1 °/s" in caplog.text
    load(saved(tmp_path, gyro_rad_s=read, rate_hz=4.0))
    assert "at 4 Hz rests cannot be detected" in caplog.text


@pytest.mark.parametrize(
    ("device", "boot", "told"),
    [
        ("chest", "00000000000000ff", ("chest", 255)),
        ("Chest; rm", "00000000000000ff", ("", 0)),
        ("chest", "7", ("", 0)),
        (3.0, [1, 2], ("", 0)),
    ],
)
def test_whose_it_is_is_known_where_an_export_said_it(
    tmp_path: Path, device: object, boot: object, told: tuple[str, int]
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, gyro_rad_s=np.full((50, 3), 0.01), rate_hz=100.0, device=np.array(device), boot=np.array(boot))
    found = load(path)
    assert (found.device, found.boot) == told
