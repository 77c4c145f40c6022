"""What is in recordings: surveys, stretches, and recovery, of files cut, joined and torn."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.drivers import replayed
from bridge.recording import load, message_kinds
from bridge.recording.error import RecordingError
from bridge.recording.files import Folder
from bridge.recording.mcap_writer import McapWriter
from bridge.recording.recorder import WardRecorder
from bridge.recording.recover import recover
from bridge.recording.settings import Recorder
from bridge.recording.stretches import read
from bridge.recording.survey import survey
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Note, SampleBatch, Verdict
from tests.bridge.recording.crowd import STEP, TICK_S, WARD, corrected, info, samples
from tests.sentences import free

NOW = 1_790_000_000_000_000_000
S = 1_000_000_000
SETTINGS = Recorder(keep_free_mb=0, rotate="never")


def at_ns(sequence: int) -> int:
    return NOW + sequence * STEP * 1000


def said(batch: SampleBatch) -> list[Message]:
    raw = keys.build(WARD, "raw", bridge="bridge-1", device=batch.device)
    out = keys.build(WARD, "corrected", device=batch.device)
    return [Message(raw, codec.encode_samples(batch)), Message(out, codec.encode_corrected(corrected(batch)))]


def about(device: str, boot: int = 7) -> Message:
    key = keys.build(WARD, "info", bridge="bridge-1", device=device)
    return Message(key, codec.encode_info(info(device, NOW, boot)))


def run(device: str, first: int, last: int, boot: int = 7, later_ns: int = 0) -> list[Message]:
    """Samples first to last of a device, batch by batch."""
    batches = [samples(device, at, min(5, last - at), at_ns(at) + later_ns, boot) for at in range(first, last, 5)]
    return [message for batch in batches for message in said(batch)]


def recorded(folder: Path, *parts: list[Message]) -> list[Path]:
    """A file of each part."""
    recorder = WardRecorder(Folder(folder, WARD), WARD, SETTINGS)
    paths = []
    for number, part in enumerate(parts):
        recorder.begin(NOW + number * S, 0.0)
        for at in range(0, len(part), 7):
            recorder.take(part[at : at + 7], NOW, 0.0)
            recorder.tick(NOW, float(at))
        recorder.close()
        paths.append(recorder.account.files[-1])
    return paths


def marked() -> list[Message]:
    calibration = Calibration(
        "one", 7, "c1", NOW + 2 * S, "closure", Verdict.ACCEPTED, free("three turns"), np.eye(3), np.zeros(3), (),
        np.zeros((0, 0)), (), np.ones(3), "m", "f", 8.7, 104.0, 30.0, "anna",
    )  # fmt: skip
    return [
        Message(keys.build(WARD, "calibration", device="one"), codec.encode_calibration(calibration)),
        Message(
            keys.build(WARD, "note", device="one"), codec.encode_note(Note("one", 7, NOW + 3 * S, "anna", "sat up"))
        ),
    ]


def test_a_survey_has_devices_boots_gaps_calibrations_and_notes(tmp_path: Path) -> None:
    part = [about("one"), *run("one", 0, 200), *run("one", 230, 400), *marked(), *run("two", 0, 50)]
    part += run("two", 0, 100, boot=8, later_ns=20 * S)
    found = survey(recorded(tmp_path, part))
    assert (list(found.devices), found.wards, found.trouble) == (["one", "two"], {WARD}, [])
    one = found.devices["one"].boots[7]
    assert (one.samples, one.missing, one.gaps, one.repeated) == (370, 30, 1, 0)
    assert one.rate_hz == pytest.approx(1 / (STEP * TICK_S))
    assert one.corrected == {"GOOD": 370}
    assert (one.first_ns, one.last_ns) == (NOW, at_ns(399))
    assert [boot.samples for boot in found.devices["two"].boots.values()] == [50, 100]
    assert [c.reason for c in found.devices["one"].calibrations.values()] == [free("three turns")]
    assert [n.text for n in found.devices["one"].notes.values()] == ["sat up"]
    assert found.duration_s == pytest.approx(20 + 99 * STEP * TICK_S)


def only(what: str, messages: list[Message]) -> list[Message]:
    return [message for message in messages if what in message.key]


def test_stretches_are_the_samples_as_they_were(tmp_path: Path) -> None:
    part = [about("one"), *run("one", 0, 200), *run("one", 230, 400), *run("one", 0, 60, boot=8, later_ns=20 * S)]
    first, second = read(recorded(tmp_path, part)).stretches["one"]
    whole = samples("one", 0, 400, NOW)
    kept = np.r_[0:200, 230:400]
    np.testing.assert_array_equal(first.gyro, whole.gyro[kept])
    np.testing.assert_array_equal(first.sequence, kept)
    np.testing.assert_array_equal(first.ticks, whole.ticks[kept])
    np.testing.assert_array_equal(first.time_ns, NOW + kept * STEP * 1000)
    np.testing.assert_array_equal(first.computed["rate_rad_s"], 2 * first.gyro)
    assert (first.boot, first.number, second.boot, second.number, len(second)) == (7, 1, 8, 2, 60)
    assert first.rate_hz == 104.0
    assert second.info is None
    assert second.rate_hz == pytest.approx(1 / (STEP * TICK_S))


def test_files_join_in_order_of_time_and_repeats_count_once(tmp_path: Path) -> None:
    one, two = recorded(tmp_path, [*run("one", 0, 100), *marked()], [*marked(), *run("one", 80, 205)])
    for paths in ([one, two], [two, one]):
        recorded_ = read(paths)
        (stretch,) = recorded_.stretches["one"]
        np.testing.assert_array_equal(stretch.sequence, np.arange(205))
        assert (len(recorded_.notes), len(recorded_.calibrations)) == (1, 1)
        (boot,) = survey(paths).devices["one"].boots.values()
        assert (boot.samples, boot.repeated, boot.missing) == (205, 20, 0)


def test_columns_that_come_and_go(tmp_path: Path) -> None:
    from dataclasses import replace

    batches = [samples("one", at, 5, at_ns(at)) for at in range(0, 30, 5)]
    batches[0] = replace(batches[0], temperature_c=np.full(5, 20, np.float32))
    batches[1] = replace(batches[1], temperature_c=None)
    batches[3] = replace(batches[3], accel=None)
    (stretch,) = read(recorded(tmp_path, [m for batch in batches for m in said(batch)])).stretches["one"]
    assert stretch.accel is None
    assert stretch.temperature_c is not None
    assert stretch.temperature_c[4] == 20
    assert (np.diff(stretch.temperature_c[4:11]) > 0).all()
    assert stretch.temperature_c[10] == 30.5


# ---- recovery ---------------------------------------------------------------------------------------------------------


def test_recovery_keeps_what_is_whole_and_says_what_is_lost(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, [about("one"), *run("one", 0, 300)])
    data = path.read_bytes()
    path.unlink()
    for part in (0.999, 0.9, 0.5):
        torn = tmp_path / "x.mcap.part"
        torn.write_bytes(data[: int(part * len(data))])
        done = recover(torn)
        assert done.out == tmp_path / "x.mcap"
        found = survey([done.out])
        assert found.trouble == []
        assert found.messages == done.messages
        assert done.trouble
        assert any("UTC" in line for line in done.said())
        assert torn.exists()
        done.out.unlink()
    assert not list(tmp_path.glob(".*"))


def test_what_cannot_be_recovered_is_said(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, run("one", 0, 50))
    with pytest.raises(RecordingError, match="the recording is complete: nothing to recover"):
        recover(path)
    part = path.with_name("y.mcap.part")
    part.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RecordingError, match="nothing can be recovered"):
        recover(part)
    part.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RecordingError, match="exists already"):
        recover(part, path)
    with pytest.raises(RecordingError, match="cannot be written"):
        recover(part, tmp_path / "nowhere" / "z.mcap")


def test_a_file_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    folder = Folder(tmp_path, WARD)
    recorder = WardRecorder(folder, WARD, SETTINGS)
    recorder.begin(NOW, 0.0)
    recorder.take(run("one", 0, 50), NOW, 0.0)
    recorder.tick(NOW, 0.0)
    (part,) = tmp_path.glob("*.part")
    with pytest.raises(RecordingError, match="still being recorded"):
        recover(part)
    assert folder.leftovers() == []
    assert survey([part]).devices["one"].boots[7].samples == 50, "but it can be looked into"
    recorder.close()


def test_what_a_killed_recorder_left_is_found(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, run("one", 0, 50))
    left = path.rename(path.with_name(path.name + ".part"))
    assert Folder(tmp_path, WARD).leftovers() == [left]
    assert Folder(tmp_path, "other").leftovers() == []
    assert recover(left).out == path


def test_what_is_refused_is_said_by_all_who_read_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = BytesIO()
    writer = McapWriter(file, "truerate", {"ward": WARD})
    for device in ("one", "two"):
        facts = {"key": keys.build(WARD, "raw", bridge="bridge-1", device="one")}  # of the second, another's
        channel = writer.channel(f"raw/bridge-1/{device}", "truerate.v1.SampleBatch", message_kinds.DESCRIPTORS, facts)
        for message in only("raw", run(device, 0, 100)):
            writer.add(channel, NOW, NOW, message.payload)
    writer.finish()
    path = tmp_path / "x.mcap"
    path.write_bytes(file.getvalue())
    found = read([path])
    assert list(found.stretches) == ["one"]
    assert "20 messages skipped: with the id of another device or bridge" in found.trouble
    assert replayed.devices(path) == ["one"]
    assert "20 messages skipped" in caplog.text
    caplog.clear()
    assert load(path).device == "one"
    assert "20 messages skipped" in caplog.text


# ---- as a recording of one device -------------------------------------------------------------------------------------


def test_a_wards_recording_is_a_recording(tmp_path: Path) -> None:
    path, several = recorded(
        tmp_path,
        [about("one"), *run("one", 0, 200)],
        [*run("one", 0, 90), *run("two", 0, 60), *run("two", 0, 70, boot=8)],
    )
    recording = load(path)
    assert (len(recording), recording.rate_hz, recording.gyro_range) == (200, 104.0, 8.7)
    np.testing.assert_array_equal(recording.gyro, samples("one", 0, 200, NOW).gyro)
    np.testing.assert_allclose(recording.time_s, np.arange(200) * STEP * TICK_S)
    for kwargs, words in (
        ({}, "2 devices; choose one with --device: one, two"),
        ({"device": "three"}, "no samples of --device 'three'; choose from one, two"),
        ({"device": "two"}, "two has 2 boots; choose one with --boot: 1 (60 samples), 2 (70 samples)"),
        ({"device": "two", "boot": 3}, "two has no boot 3: give --boot 1 to 2"),
    ):
        with pytest.raises(RecordingError) as refused:
            load(several, **kwargs)
        assert words in str(refused.value)
    assert len(load(several, device="two", boot=2)) == 70
    assert len(load(several, device="one")) == 90
