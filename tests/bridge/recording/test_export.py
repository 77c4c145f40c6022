"""Exports are read back as they were; a BIDS dataset has what its specification requires."""

import csv
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.recording import load, opensim
from bridge.recording.bids import Session, channels, export_bids
from bridge.recording.error import RecordingError
from bridge.recording.export import export
from bridge.recording.stretches import Recorded, read
from bridge.wire import keys
from bridge.wire.codec import decode_samples, encode_orientation, encode_status
from bridge.wire.messages import OrientationBatch, Placement, Quality
from tests.bridge.recording.crowd import STEP, TICK_S, status
from tests.bridge.recording.test_contents import S, about, marked, recorded, run

VALIDATOR = shutil.which("bids-validator-deno")


def table_of(path: Path) -> list[dict[str, str]]:
    delimiter = "\t" if path.suffix == ".tsv" else ","
    return list(csv.DictReader(path.read_text().splitlines(), delimiter=delimiter))


@pytest.fixture
def some(tmp_path: Path) -> Recorded:
    (tmp_path / "rec").mkdir()
    part = [about("wrist-left"), *run("wrist-left", 0, 200), *run("wrist-left", 230, 400), about("one"), *marked()]
    part += [message for message in run("one", 0, 500) if "raw" in message.key]
    part += [message for message in run("one", 50, 500) if "corrected" in message.key]
    part += run("one", 0, 100, boot=8, later_ns=30 * S)
    return read(recorded(tmp_path / "rec", part))


@pytest.mark.parametrize("ending", [".npz", ".csv"])
def test_an_export_is_a_recording(some: Recorded, tmp_path: Path, ending: str) -> None:
    paths = export(some, tmp_path / "out", ending)
    assert [path.name for path in paths] == [
        f"one_boot1{ending}", f"one_boot2{ending}", f"wrist-left{ending}", "events.csv",
    ]  # fmt: skip
    for path, stretch in zip(paths, [*some.stretches["one"], *some.stretches["wrist-left"]], strict=False):
        recording = load(path)
        np.testing.assert_array_equal(recording.gyro.astype(np.float32), stretch.gyro)
        assert recording.accel is not None
        assert stretch.accel is not None
        np.testing.assert_array_equal(recording.accel.astype(np.float32), stretch.accel)
        assert recording.temperature_c is not None
        np.testing.assert_allclose(recording.time_s, stretch.time_s, atol=1e-9)
        assert recording.rate_hz == pytest.approx(104.0, rel=1e-4)
        assert not any("other times" in note for note in recording.notes)


def test_corrected_rates_are_beside_the_readings(some: Recorded, tmp_path: Path) -> None:
    export(some, tmp_path / "out", ".npz")
    export(some, tmp_path / "csv", ".csv")
    with np.load(tmp_path / "out" / "one_boot1.npz") as file:
        assert (file["quality"] == np.where(np.arange(500) < 50, -1, 3)).all()
        np.testing.assert_array_equal(file["rate_rad_s"][50:], 2 * file["gyro_rad_s"][50:])
        assert np.isnan(file["rate_rad_s"][:50]).all()
        assert (str(file["device"]), str(file["boot"]), float(file["rate_hz"])) == ("one", f"{7:016x}", 104.0)
        rows = table_of(tmp_path / "csv" / "one_boot1.csv")
        assert [float(row["rate_x_rad_s"]) for row in rows[50:]] == pytest.approx(file["rate_rad_s"][50:, 0].tolist())
        assert [int(row["host_time_ns"]) for row in rows] == file["host_time_ns"].tolist()
        assert rows[0]["rate_std_z_rad_s"] == "nan"
        assert rows[0]["quality"] == "-1"


def test_orientation_is_beside_the_readings(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    part = run("one", 0, 200)
    first = next(decode_samples(message.key, message.payload) for message in part if "raw" in message.key)
    turned = OrientationBatch(
        "one", first.boot, first.sequence, first.start_time_ns, first.tick_period_s, first.clock_rate, first.ticks,
        np.tile(np.array([0.6, 0, 0.8, 0], np.float32), (len(first), 1)), None, np.diag([1, 3, 9]).astype(np.float32), 0, "start",
        Quality.GOOD,
    )  # fmt: skip
    key = keys.build(keys.parse(part[0].key).ward, "orientation", device="one")
    written = recorded(tmp_path / "rec", [about("one"), *part, Message(key, encode_orientation(turned))])
    n = len(first)
    export(read(written), tmp_path / "npz", ".npz")
    export(read(written), tmp_path / "csv", ".csv")
    with np.load(next((tmp_path / "npz").glob("one*.npz"))) as file:
        np.testing.assert_array_equal(file["quat_wxyz"][:n], turned.quat_wxyz)
        assert np.isnan(file["quat_wxyz"][n:]).all()
        assert (file["tilt_std"][:n] == 2).all()
        assert (file["heading_std"][:n] == 3).all()
    opensim.convert(written, tmp_path / "one.sto", ["one"], None, {"one": "pelvis"})
    head, *rows = (tmp_path / "one.sto").read_text().partition("endheader\n")[2].splitlines()
    assert head == "time\tpelvis_imu"
    assert len(rows) == n
    np.testing.assert_allclose(
        [float(part) for part in rows[-1].split("\t")[1].split(",")], turned.quat_wxyz[-1], rtol=1e-6
    )
    row = table_of(next((tmp_path / "csv").glob("one*.csv")))[0]
    assert [row[f"quat_{axis}"] for axis in "wxyz"] == ["0.600000024", "0", "0.800000012", "0"]
    assert [one.name for one in channels(read(written).stretches["one"][0]) if one.type == "ORNT"] == [
        "quat_w", "quat_x", "quat_y", "quat_z",
    ]  # fmt: skip


def test_events_have_boots_calibrations_and_notes(some: Recorded, tmp_path: Path) -> None:
    *_, path = export(some, tmp_path / "out", ".csv")
    rows = table_of(path)
    assert [(row["device"], row["event"], row["text"]) for row in rows] == [
        ("one", "boot", "lsm9ds1"),
        ("wrist-left", "boot", "lsm9ds1"),
        ("one", "calibration accepted", "three turns"),
        ("one", "note by anna", "sat up"),
        ("one", "boot", ""),
    ]
    assert [float(row["t_s"]) for row in rows] == [0, 0, 2, 3, 30]


def test_a_placement_is_in_the_events_and_in_bids(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    part = run("one", 0, 200)
    first = next(decode_samples(message.key, message.payload) for message in part if "raw" in message.key)
    at = first.start_time_ns + S
    key = keys.build(keys.parse(part[0].key).ward, "status", device="one")
    worn = [Placement("torso", "", "bed-1", 5, "bo"), Placement("humerus", "left", "bed-3", at, "anna")]
    worn.append(Placement("hand", "left", "later", first.start_time_ns + 10**6 * S))
    said = [Message(key, encode_status(replace(status("one", at), placement=one))) for one in worn]
    written = read(recorded(tmp_path / "rec", [about("one"), *part, *said]))
    assert written.stretches["one"][0].placements == (worn[0], worn[1])
    assert opensim._body(written.stretches["one"][0]) == "humerus_l"
    *_, path = export(written, tmp_path / "out", ".csv")
    rows = [(float(row["t_s"]), row["event"], row["text"]) for row in table_of(path) if "placement" in row["event"]]
    assert rows == [(0.0, "placement by bo", "torso, bed-1"), (1.0, "placement by anna", "humerus left, bed-3")]
    export_bids(written, tmp_path / "set", Session("07", "ward"))
    (channels_tsv,) = (tmp_path / "set").rglob("*_channels.tsv")
    assert {row["placement"] for row in table_of(channels_tsv)} == {"humerus left, bed-3"}


def test_after_an_erased_placement_nobody_wears_the_device(tmp_path: Path) -> None:
    part = run("one", 0, 200)
    first = next(decode_samples(message.key, message.payload) for message in part if "raw" in message.key)
    key = keys.build(keys.parse(part[0].key).ward, "status", device="one")
    (tmp_path / "rec").mkdir()
    said = [
        Message(key, encode_status(replace(status("one", first.start_time_ns + after), placement=worn)))
        for after, worn in ((0, Placement("torso", "", "bed-1", 5, "bo")), (S // 2, None))
    ]
    (stretch,) = read(recorded(tmp_path / "rec", [about("one"), *part, *said])).stretches["one"]
    assert [str(one) for one in stretch.placements] == ["torso, bed-1", "nobody"]


def test_what_somebody_wrote_is_no_formula_of_a_spreadsheet(some: Recorded, tmp_path: Path) -> None:
    (note,) = some.notes
    said = ['=cmd|" /C calc"!A0', "@SUM(1)", "+1", "-1", "1+1", "sat up"]
    export(replace(some, notes=[replace(note, text=text) for text in said]), tmp_path / "out", ".csv")
    texts = [row["text"] for row in table_of(tmp_path / "out" / "events.csv") if row["event"] == "note by anna"]
    assert sorted(texts) == sorted([*(f"'{text}" for text in said[:4]), *said[4:]])


def test_nothing_is_overwritten(some: Recorded, tmp_path: Path) -> None:
    export(some, tmp_path / "out", ".npz")
    with pytest.raises(RecordingError, match=r"one_boot1.npz: exists already and is not overwritten"):
        export(some, tmp_path / "out", ".npz")
    with pytest.raises(RecordingError, match=r"the folder .* does not exist; make it"):
        export(some, tmp_path / "no" / "such", ".npz")
    with pytest.raises(RecordingError, match=r"events.csv: exists already"):
        export(some, tmp_path / "out", ".csv")
    assert [path.name for path in (tmp_path / "out").glob("*.csv")] == [
        "events.csv"
    ]  # none is written where one is refused
    (tmp_path / "file").write_text("x")
    with pytest.raises(RecordingError, match="cannot be made"):
        export(some, tmp_path / "file", ".npz")


def test_a_bids_dataset_has_what_is_required(some: Recorded, tmp_path: Path) -> None:
    export_bids(some, tmp_path / "set", Session("07", "ward"))
    motion = tmp_path / "set" / "sub-07" / "motion"
    stem = "sub-07_task-ward_tracksys-one_run-1"
    sidecar = json.loads((motion / f"{stem}_motion.json").read_text())
    assert {"TaskName": "ward", "TrackingSystemName": "one", "SamplingFrequency": 104.0}.items() <= sidecar.items()
    assert sidecar["SamplingFrequencyEffective"] == pytest.approx(1 / (STEP * TICK_S))
    channels = table_of(motion / f"{stem}_channels.tsv")
    assert list(channels[0])[:5] == ["name", "component", "type", "tracked_point", "units"]
    assert sidecar["GYROChannelCount"] == sum(channel["type"] == "GYRO" for channel in channels) == 6
    table = [line.split("\t") for line in (motion / f"{stem}_motion.tsv").read_text().splitlines()]
    assert (len(table), {len(row) for row in table}) == (500, {len(channels)})
    at = [channel["name"] for channel in channels].index("rate_y")
    (boot, _) = some.stretches["one"]
    assert table[0][at] == "n/a"
    assert float(table[77][at]) == pytest.approx(float(boot.computed["rate_rad_s"][77, 1]))
    events = table_of(motion / f"{stem}_events.tsv")
    assert [(row["onset"], row["trial_type"]) for row in events] == [("2.000", "calibration"), ("3.000", "note")]
    scans = table_of(motion.parent / "sub-07_scans.tsv")
    assert [(tmp_path / "set" / "sub-07" / row["filename"]).exists() for row in scans] == [True] * 3
    assert scans[0]["acq_time"].startswith("2026-")


def test_a_dataset_grows_by_subjects(some: Recorded, tmp_path: Path) -> None:
    for subject in ("07", "08"):
        export_bids(some, tmp_path / "set", Session(subject, "ward"))
    assert (tmp_path / "set" / "participants.tsv").read_text() == "participant_id\nsub-07\nsub-08\n"
    with pytest.raises(RecordingError, match="exists already"):
        export_bids(some, tmp_path / "set", Session("08", "ward"))
    motion = tmp_path / "set" / "sub-09" / "motion"
    motion.mkdir(parents=True)
    (motion / "sub-09_task-ward_tracksys-wristleft_channels.json").touch()
    with pytest.raises(RecordingError, match=r"wristleft_channels.json: exists already"):
        export_bids(some, tmp_path / "set", Session("09", "ward"))
    assert len(list(motion.iterdir())) == 1
    with pytest.raises(RecordingError, match="--subject 'Mrs Doe': BIDS allows only letters and digits"):
        Session("Mrs Doe", "ward")
    with pytest.raises(RecordingError, match="--task ''"):
        Session("07", "")


def test_what_a_person_has_in_a_dataset_stays(some: Recorded, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "README").write_text("ours")
    export_bids(some, tmp_path / "set", Session("07", "ward"))
    assert (tmp_path / "set" / "README").read_text() == "ours"
    assert (tmp_path / "set" / "dataset_description.json").exists()
    before = set(tmp_path.rglob("*"))
    for name, session in (("participants.tsv", "08"), ("sub-09/sub-09_scans.tsv", "09")):
        table = tmp_path / "set" / name
        table.parent.mkdir(exist_ok=True)
        table.write_bytes("participant_id\tname\nsub-07\tMüller\n".encode("latin-1"))
        with pytest.raises(RecordingError, match=f"{table.name}: not UTF-8"):
            export_bids(some, tmp_path / "set", Session(session, "ward"))
        table.unlink()
    assert {path for path in set(tmp_path.rglob("*")) - before if path.is_file()} == set()


@pytest.mark.skipif(VALIDATOR is None, reason="bids-validator-deno is not installed: pip install --group bids")
def test_the_bids_validator_finds_no_error(some: Recorded, tmp_path: Path) -> None:
    export_bids(some, tmp_path / "set", Session("07", "ward", "a"))
    command = [str(VALIDATOR), "--json", str(tmp_path / "set")]
    said = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    issues = json.loads(said.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue.get("severity") == "error"] == []
