"""Recordings in other tools' formats: each gives the session's k and bias, and refusals say what to do."""

import gzip
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import StoragePlugin

from bridge.recording import Reading, RecordingError, load
from bridge.recording.error import MAX_BYTES
from estimator.cli.main import main
from tests.bridge.recording.formats import written
from tests.bridge.recording.text.session import ACCEL_MS2, GYRO_DPS, TIME, refusal, right

GYRO = [(f"GyroX {axis}".replace("X ", ""), "deg/s") for axis in "XYZ"]
BARE = [(axis, "") for axis in "XYZ"]

FILES: dict[str, Callable[[Path], Path]] = {
    "ros1": lambda folder: written.bag1(folder / "a.bag"),
    "ros1 without stamps": lambda folder: written.bag1(folder / "a.bag", stamped=False),
    "ros2 sqlite": lambda folder: written.bag2(folder / "bag", StoragePlugin.SQLITE3),
    "ros2 mcap": lambda folder: written.bag2(folder / "bag", StoragePlugin.MCAP),
    "one .db3": lambda folder: written.bag2(folder / "bag", StoragePlugin.SQLITE3) / "bag.db3",
    "one .mcap": lambda folder: written.bag2(folder / "bag", StoragePlugin.MCAP) / "bag.mcap",
    "xdf": lambda folder: written.xdf(
        folder / "a.xdf",
        [("EEG", [(f"C{n}", "microvolts") for n in range(4)], np.zeros((len(TIME), 4))), ("IMU", GYRO, GYRO_DPS)],
    ),
    "ximu3": lambda folder: written.ximu3(folder / "a.ximu3"),
    "euroc": lambda folder: written.euroc(folder / "MH_01"),
    "bids": written.bids,
    "opal 5": lambda folder: written.opal5(folder / "a.h5"),
    "opal 4": lambda folder: written.opal4(folder / "a.h5"),
    "parquet": lambda folder: written.parquet(folder / "a.parquet"),
    "cwa": lambda folder: written.cwa(folder / "a.cwa"),
}


@pytest.mark.parametrize("form", FILES)
def test_a_session_is_read(form: str, tmp_path: Path) -> None:
    path = FILES[form](tmp_path)
    right(path)
    recording = load(path)
    samples = len(recording)
    assert samples == (len(TIME) if form != "cwa" else len(TIME) // 40 * 40)
    assert np.allclose(recording.gyro, written.RATE[:samples], atol=6e-4 if form == "cwa" else 1e-6)
    if form != "xdf":
        assert recording.accel is not None
        assert np.allclose(recording.accel, ACCEL_MS2[:samples], atol=3e-3 if form == "cwa" else 1e-5)
    assert main(["recording", "inspect", str(path)]) == 0


def test_a_device_that_the_file_names_is_corrected_with_its_noise_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, stated = written.ximu3(tmp_path / "a.ximu3"), "noise model factory-calibrated, from the device"
    assert main(["correct", str(path), str(tmp_path / "stated.npz")]) == 0
    assert stated in capsys.readouterr().out
    assert main(["correct", str(path), str(tmp_path / "told.npz"), "--model", "generic"]) == 0
    assert stated not in capsys.readouterr().out
    first = [float(np.load(tmp_path / f"{name}.npz")["rate_std_rad_s"][0, 0]) for name in ("stated", "told")]
    assert first[0] < 0.2 * first[1]


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (lambda folder: written.bag1(folder / "a.bag", ("/imu/left", "/imu/right")), ("/imu/left", "/imu/right")),
        (
            lambda folder: written.xdf(folder / "a.xdf", [("Left", GYRO, GYRO_DPS), ("Right", GYRO, GYRO_DPS)]),
            ("Left", "Right"),
        ),
        (lambda folder: written.euroc(folder / "room", ("imu0", "imu1")), ("imu0", "imu1")),
        (lambda folder: written.bids(folder, ("wrist", "ankle")), ("wrist", "ankle")),
        (lambda folder: written.opal5(folder / "a.h5", ("Lumbar", "Left Foot")), ("Lumbar", "Left Foot")),
    ],
    ids=["ros", "xdf", "euroc", "bids", "hdf5"],
)
def test_one_of_several_streams_is_chosen_by_the_name_that_the_error_lists(
    make: Callable[[Path], Path], names: tuple[str, str], tmp_path: Path
) -> None:
    path = make(tmp_path)
    assert f"choose one with --device: {', '.join(names)}" in refusal(path)
    assert "choose from" in refusal(path, Reading(device="nobody"))
    for name in names:
        right(path, Reading(device=name))
    out = tmp_path / "out.npz"
    assert main(["recording", "convert", str(path), str(out), "--device", names[1]]) == 0
    right(out)


def test_a_stream_named_after_its_sensor_needs_only_a_unit(tmp_path: Path) -> None:
    path = written.xdf(tmp_path / "phone.xdf", [("Gyroscope", BARE, written.RATE), ("Accelerometer", BARE, ACCEL_MS2)])
    assert "--gyro-unit" in refusal(path)
    right(path, Reading(gyro_unit="rad/s"))


def test_a_topic_without_angular_velocity_is_refused(tmp_path: Path) -> None:
    assert "carry no angular velocity" in refusal(written.bag1(tmp_path / "a.bag", no_gyro=True))


def test_an_axivity_without_gyroscope_is_refused(tmp_path: Path) -> None:
    assert "no gyroscope" in refusal(written.cwa(tmp_path / "a.cwa", gyro=False))


def test_a_motion_file_without_its_channels_names_them(tmp_path: Path) -> None:
    path = written.bids(tmp_path)
    path.with_name(path.name.replace("motion.tsv", "channels.tsv")).unlink()
    assert "_channels.tsv" in refusal(path)


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    assert "neither a ROS 2 bag" in refusal(tmp_path)


@pytest.mark.parametrize("ending", ["bag", "db3", "mcap", "xdf", "ximu3", "h5", "parquet", "cwa"])
@pytest.mark.parametrize(
    "content", [b"", b"\x89MCAP0\r\n\x01" + bytes(7) + b"\x04\0\0\0ros2" + bytes(99), b"AX\0" * 4000]
)
def test_a_damaged_file_is_refused(ending: str, content: bytes, tmp_path: Path) -> None:
    (path := tmp_path / f"a.{ending}").write_bytes(content)
    refusal(path)


@pytest.mark.parametrize("ending", ["bag", "xdf", "h5", "parquet", "cwa"])
def test_a_torn_file_is_refused_or_read_in_part(ending: str, tmp_path: Path) -> None:
    whole = {"bag": "ros1", "xdf": "xdf", "h5": "opal 5", "parquet": "parquet", "cwa": "cwa"}[ending]
    path = FILES[whole](tmp_path)
    data = path.read_bytes()
    for cut in np.random.default_rng(0).integers(1, len(data), 12):
        path.write_bytes(data[: int(cut)])
        with suppress(RecordingError):
            assert len(load(path)) <= len(TIME)


@pytest.mark.parametrize("ending", ["h5", "parquet"])
def test_what_convert_and_correct_write_is_read_back(ending: str, tmp_path: Path) -> None:
    path = written.euroc(tmp_path / "room")
    out, corrected = tmp_path / f"a.{ending}", tmp_path / f"corrected.{ending}"
    assert main(["recording", "convert", str(path), str(out)]) == 0
    right(out)
    for _ in range(2):  # what it wrote it may overwrite
        assert main(["correct", str(out), str(corrected)]) == 0
    assert main(["correct", str(out), str(tmp_path / "corrected.npz")]) == 0
    again, expected = load(corrected), load(tmp_path / "corrected.npz")
    assert np.allclose(again.gyro, expected.gyro, atol=1e-9)
    assert np.allclose(again.time_s, expected.time_s, atol=1e-9)
    assert main(["correct", str(out), str(out)]) == 1
    assert main(["correct", str(corrected), str(out)]) == 1  # a recording is no corrected one


@pytest.mark.parametrize(
    ("package", "name", "extra"),
    [
        ("rosbags", "a.bag", "ros"),
        ("pyxdf", "a.xdf", "xdf"),
        ("h5py", "a.h5", "hdf5"),
        ("pyarrow", "a.parquet", "parquet"),
        ("cwa_reader_rs", "a.cwa", "cwa"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(package: str, name: str, extra: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"x" * 100)
    program = (
        f"import sys; sys.modules[{package!r}] = None; from estimator.cli.main import main; "
        f"sys.exit(main(['recording', 'inspect', {str(tmp_path / name)!r}]))"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr.rstrip().endswith(f"need the package {package}: pip install 'truerate[{extra}]'")
    assert ran.stderr.count("\n") == 1


def test_an_output_whose_package_is_missing_is_refused_before_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.delitem(sys.modules, "bridge.recording.formats.hdf5", raising=False)
    assert main(["recording", "convert", str(tmp_path / "none.csv"), str(tmp_path / "out.h5")]) == 2
    assert main(["correct", str(tmp_path / "none.csv"), str(tmp_path / "out.h5")]) == 1


def test_a_dataset_that_is_kept_in_another_file_is_not_read(tmp_path: Path) -> None:
    private, path = tmp_path / "private", tmp_path / "a.h5"
    private.write_bytes(bytes(range(30)))
    with h5py.File(path, "w") as file:
        file.create_dataset("gyro_rad_s", shape=(10, 3), dtype="u1", external=[(str(private), 0, 30)])
    assert "refers to another file" in refusal(path)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["gyro_rad_s"] = np.ones((10, 3))
    with h5py.File(path, "w") as file:
        file["gyro_rad_s"] = h5py.ExternalLink("b.h5", "/gyro_rad_s")
    assert "refers to another file" in refusal(path)


@pytest.mark.parametrize("form", ["npz", "h5", "parquet", "xdfz"])
def test_a_small_file_that_unpacks_to_much_is_refused_before_it_does(form: str, tmp_path: Path) -> None:
    path, rows = tmp_path / f"a.{form}", MAX_BYTES // 16
    if form == "npz":
        np.savez_compressed(path, gyro_rad_s=np.zeros((rows, 3), np.int8))  # 1.5 times the limit as float64
    elif form == "h5":
        with h5py.File(path, "w") as file:
            file.create_dataset("gyro_rad_s", shape=(rows, 3), dtype="i1", chunks=(1 << 20, 3))
    elif form == "parquet":
        pq.write_table(pa.table(dict.fromkeys(("gyro_x", "gyro_y", "gyro_z"), np.zeros(rows, np.int8))), path)
    else:
        with gzip.open(path, "wb", 1) as packed:
            packed.write(b"XDF:")
            for _ in range(MAX_BYTES >> 20):
                packed.write(bytes(1 << 20))
    assert path.stat().st_size < 8 << 20
    assert f"{MAX_BYTES} " in refusal(path)


def test_a_text_named_as_a_column_of_numbers_is_not_read(tmp_path: Path) -> None:
    path, rate = tmp_path / "a.parquet", pa.array(np.zeros(10))
    names = ["gyro_x", "gyro_y", "gyro_z", "gyro_x"]
    pq.write_table(pa.table([rate, rate, rate, pa.array(["far too long"] * 10)], names=names), path)
    assert "duplicate field names" in refusal(path)


def test_a_file_of_lines_that_are_no_messages_is_given_up(tmp_path: Path) -> None:
    path = written.ximu3(tmp_path / "a.ximu3")
    path.write_bytes(b"\n" * 1000 + path.read_bytes() + b"a\n" * 9_000)
    assert "9000 message unknown" in right(path)
    path.write_bytes(path.read_bytes() + b"a\n" * 9_000_000)
    assert "most messages cannot be decoded" in refusal(path)
