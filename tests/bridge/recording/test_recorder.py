"""The recorder's core: what is recorded, when a file ends, and what it does when a file refuses."""

import dataclasses
import errno
import logging
import os
from collections.abc import Iterator
from io import FileIO
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from bridge.bus.contract import Message
from bridge.recording import files
from bridge.recording.mcap_reader import Entry, McapReader
from bridge.recording.mcap_writer import MAX_CHANNELS
from bridge.recording.recorder import ROOM_BYTES, WardRecorder
from bridge.recording.recording_file import MOST_OF_A_BRIDGE
from bridge.recording.settings import Recorder
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Note, Verdict
from tests.bridge.recording.crowd import WARD, corrected, info, samples, status

NOW = 1_790_000_000_000_000_000
S = 1_000_000_000
SETTINGS = Recorder(rotate="10s", rotate_mb=1.0, keep_free_mb=100.0)


class Disk(files.Folder):
    """A real folder, on a disk whose free space and errors a test sets."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, WARD)
        self.outputs = list[files.Output]()
        self.error, self.free = 0, 1_000_000_000

    def begin(self, wall_ns: int) -> files.Output:
        output = super().begin(wall_ns)
        output.file.close()
        output.file = _File(files.with_part(output.path), self)
        self.outputs.append(output)
        return output

    def free_bytes(self) -> int:
        return self.free


class _File(FileIO):
    def __init__(self, path: Path, disk: Disk) -> None:
        super().__init__(path, "r+b")
        self._disk = disk

    def write(self, data: bytes) -> int:  # type: ignore[override] # a buffer is one
        if self._disk.error:
            raise OSError(self._disk.error, "no")
        return super().write(data)


def entries(of: files.Output) -> list[Entry]:
    """What is in a file, finished or not."""
    with (of.path if of.path.exists() else files.with_part(of.path)).open("rb") as file:
        return list(McapReader(file, str(of.path)).entries())


def topics(of: files.Output) -> list[str]:
    return [entry.topic for entry in entries(of)]


@pytest.fixture
def disk(tmp_path: Path) -> Disk:
    return Disk(tmp_path)


@pytest.fixture
def recorder(disk: Disk) -> Iterator[WardRecorder]:
    made = WardRecorder(disk, WARD, SETTINGS)
    made.begin(NOW, 0.0)
    yield made
    made.close()


def raw(device: str, sequence: int, time_ns: int = NOW) -> Message:
    key = keys.build(WARD, "raw", bridge="bridge-1", device=device)
    return Message(key, codec.encode_samples(samples(device, sequence, 5, time_ns)))


def of_all_kinds(device: str, time_ns: int = NOW) -> list[Message]:
    batch = samples(device, 0, 5, time_ns)
    return [
        Message(keys.build(WARD, "info", bridge="bridge-1", device=device), codec.encode_info(info(device, time_ns))),
        raw(device, 0, time_ns),
        Message(keys.build(WARD, "corrected", device=device), codec.encode_corrected(corrected(batch))),
        Message(keys.build(WARD, "status", device=device), codec.encode_status(status(device, time_ns))),
        Message(keys.build(WARD, "note", device=device), codec.encode_note(Note(device, 7, time_ns, "anna", "sat up"))),
    ]


def test_payloads_are_as_they_came_under_the_messages_own_time(recorder: WardRecorder, disk: Disk) -> None:
    messages = of_all_kinds("one", NOW - 3 * S)
    recorder.take(messages, NOW, 0.0)
    recorder.close()
    (output,) = disk.outputs
    found = entries(output)
    assert [entry.payload for entry in found] == [message.payload for message in messages]
    assert topics(output) == ["info/bridge-1/one", "raw/bridge-1/one", "corrected/one", "status/one", "note/one"]
    assert {entry.log_ns for entry in found} == {entry.publish_ns for entry in found} == {NOW - 3 * S}
    assert found[1].facts == {"key": messages[1].key, "ward": WARD, "bridge": "bridge-1", "device": "one"}
    assert found[1].schema == "truerate.v1.SampleBatch"
    assert (recorder.account.raw, recorder.account.corrected) == (5, 5)
    assert recorder.account.heard == {"one": 0.0}


def test_what_is_not_understood_is_counted_and_not_written(
    recorder: WardRecorder, disk: Disk, caplog: pytest.LogCaptureFixture
) -> None:
    good = raw("one", 0)
    messages = [
        Message(good.key, b"\xff\xff"),
        Message(good.key, good.payload[:-3]),
        Message(raw("two", 0).key, good.payload),
        Message("truerate/@v1/ward/raw/*/one", good.payload),
        Message(f"truerate/@v1/{WARD}/alive/bridge/b", b""),
        good,
    ]
    with caplog.at_level(logging.WARNING):
        recorder.take(messages, NOW, 0.0)
    recorder.close()
    assert [entry.payload for entry in entries(disk.outputs[-1])] == [good.payload]
    refused = recorder.account.refused.as_dict()
    assert refused.pop("malformed") + refused.pop("length", 0) == 2
    assert refused == {"foreign_id": 1, "wildcard_key": 1, "kind_alive/bridge": 1}
    assert sum("foreign_id" in record.message for record in caplog.records) == 1


def test_only_the_devices_that_are_wanted(disk: Disk) -> None:
    recorder = WardRecorder(disk, WARD, replace(SETTINGS, devices=("two",)))
    recorder.begin(NOW, 0.0)
    recorder.take([*of_all_kinds("one"), raw("two", 0)], NOW, 0.0)
    recorder.close()
    assert topics(disk.outputs[-1]) == ["raw/bridge-1/two"]
    assert recorder.account.refused.total() == 0


def test_everything_is_safe_soon_after_it_came(
    recorder: WardRecorder, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    syncs = list[int]()
    monkeypatch.setattr("os.fsync", syncs.append)
    recorder.take([raw("one", 0)], NOW, 0.0)
    recorder.tick(NOW, 0.0)
    assert (len(entries(disk.outputs[-1])), len(syncs)) == (1, 1)
    recorder.take([raw("one", 5)], NOW, 0.1)
    recorder.tick(NOW, 0.1)
    assert len(entries(disk.outputs[-1])) == 1
    recorder.tick(NOW, 0.45)
    assert (len(entries(disk.outputs[-1])), len(syncs)) == (2, 2)


def test_a_new_file_after_its_time_begins_with_what_is_known(recorder: WardRecorder, disk: Disk) -> None:
    recorder.take(of_all_kinds("one"), NOW, 0.0)
    recorder.tick(NOW + 10 * S, 10.0)
    assert [output.path.exists() for output in disk.outputs] == [True, False]
    recorder.take([raw("one", 5, NOW + 300 * S)], NOW + 300 * S, 10.1)
    recorder.close()
    assert topics(disk.outputs[-1]) == ["info/bridge-1/one", "status/one", "raw/bridge-1/one"]
    assert recorder.account.files == [output.path for output in disk.outputs]
    assert recorder.size == sum(output.path.stat().st_size for output in disk.outputs)


def test_a_new_file_begins_with_the_calibration_that_holds(recorder: WardRecorder, disk: Disk) -> None:
    def made(name: str, verdict: Verdict) -> Message:
        of = Calibration(
            "one", 7, name, NOW, "closure", verdict, (), np.eye(3), np.zeros(3), (), np.zeros((0, 0)), (), np.ones(3),
            "m", "f", 8.7, 104.0, 30.0, "anna",
        )  # fmt: skip
        return Message(keys.build(WARD, "calibration", device="one"), codec.encode_calibration(of))

    good = made("c1", Verdict.ACCEPTED)
    recorder.take([raw("one", 0), good, made("c2", Verdict.REPEAT)], NOW, 0.0)
    recorder.tick(NOW, 11.0)
    recorder.take([raw("one", 5)], NOW, 11.0)
    recorder.close()
    assert len(disk.outputs) == 2
    assert entries(disk.outputs[-1])[0].payload == good.payload


def test_a_full_disk_is_said_and_recording_goes_on_when_there_is_room(
    recorder: WardRecorder, disk: Disk, caplog: pytest.LogCaptureFixture
) -> None:
    recorder.take([raw("one", 0)], NOW, 0.0)
    recorder.tick(NOW, 1.0)
    disk.error = errno.ENOSPC
    for second in range(2, 6):
        recorder.take([raw("one", 5 * second)], NOW, float(second))
        recorder.tick(NOW, float(second))
    account = recorder.account
    assert (account.not_recorded, account.trouble) == (4, f"{disk.path} is not writable: the disk is full")
    torn = files.with_part(disk.outputs[0].path)
    assert len(entries(disk.outputs[0])) == 1
    assert f"truerate recording recover {torn}" in caplog.text
    assert sum("Recording has stopped" in record.message for record in caplog.records) == 1
    disk.error = 0
    recorder.tick(NOW, 8.0)
    recorder.take([raw("one", 50)], NOW, 8.1)
    recorder.close()
    assert topics(disk.outputs[-1]) == ["raw/bridge-1/one"]
    assert (account.trouble, account.files) == ("", [torn, disk.outputs[-1].path])
    assert "4 messages lost meanwhile" in caplog.text


def test_a_disk_that_fills_up_ends_the_file_well_while_others_have_room(recorder: WardRecorder, disk: Disk) -> None:
    recorder.take([raw("one", 0)], NOW, 0.0)
    disk.free = 99_000_000
    recorder.tick(NOW, 1.0)
    assert (disk.outputs[0].path.exists(), len(entries(disk.outputs[0]))) == (True, 1)
    assert "nearly full" in recorder.account.trouble
    disk.free = 100_000_000 + round(ROOM_BYTES) - 1
    recorder.tick(NOW, 10.0)
    assert len(disk.outputs) == 1, "room for a moment is not enough to begin again"
    disk.free += 1
    recorder.tick(NOW, 20.0)
    recorder.close()
    assert (len(disk.outputs), recorder.account.not_recorded) == (2, 0)


def test_a_bridge_that_makes_up_devices_leaves_room_for_those_of_others(
    recorder: WardRecorder, disk: Disk, caplog: pytest.LogCaptureFixture
) -> None:
    made_up = [
        Message(
            keys.build(WARD, "info", bridge="b2", device=f"x{n}"),
            codec.encode_info(dataclasses.replace(info(f"x{n}", NOW), bridge="b2")),
        )
        for n in range(MAX_CHANNELS + 1)
    ]
    recorder.take([*of_all_kinds("before"), *made_up], NOW, 0.0)
    recorder.tick(NOW, 11.0)
    recorder.take(of_all_kinds("after"), NOW, 11.0)
    recorder.close()
    assert len(disk.outputs) == 2
    for output in disk.outputs:
        found = topics(output)
        assert sum(topic.startswith("info/b2/") for topic in found) == MOST_OF_A_BRIDGE
    assert {"info/bridge-1/before", "raw/bridge-1/after", "corrected/after", "note/after"} <= set(found)
    assert recorder.account.refused.as_dict() == {"too_many_channels": MAX_CHANNELS + 1 - MOST_OF_A_BRIDGE}
    assert recorder.account.not_recorded == MAX_CHANNELS + 1 - MOST_OF_A_BRIDGE
    assert [record.levelname for record in caplog.records] == ["ERROR"]
    assert len(recorder._latest) == MOST_OF_A_BRIDGE + 4


def test_other_devices_and_limits_are_taken_while_it_records(disk: Disk, recorder: WardRecorder) -> None:
    recorder.take([raw("chest", 0), raw("wrist", 0)], NOW, 0.0)
    recorder.use(replace(SETTINGS, devices=("wrist",), rotate="1h"))
    recorder.take([raw("chest", 1), raw("wrist", 1)], NOW + 20 * S, 20.0)
    recorder.tick(NOW + 20 * S, 20.0)
    assert len(disk.outputs) == 1, "20 s are not long any more"
    recorder.close()
    assert [topic.rpartition("/")[2] for topic in topics(disk.outputs[-1])] == ["chest", "wrist", "wrist"]


def old_files(folder: Path, *names: str, size: int = 1_000_000) -> None:
    """Files, each an hour younger than the one before, the last an hour old at NOW."""
    for number, name in enumerate(names):
        path = folder / name
        path.write_bytes(bytes(size))
        ended_ns = NOW - (len(names) - number) * 3600 * S
        os.utime(path, ns=(ended_ns, ended_ns))


OLD = [f"{WARD}-20260920T{hour:02d}0000Z.mcap" for hour in range(4)]


@pytest.mark.parametrize(
    ("limits", "left", "why"),
    [({"keep_days": 0.1}, OLD[2:], "keep_days"), ({"keep_gb": 0.0032}, OLD[1:], "keep_gb"), ({}, OLD, "")],
)
def test_the_oldest_finished_recordings_are_deleted_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, limits: dict[str, float], left: list[str], why: str
) -> None:
    others = [f"{WARD}-20260101T000000Z.mcap.part", f"{WARD}-2-20260101T000000Z.mcap", f"{WARD}-notes.mcap"]
    old_files(tmp_path, *others, *OLD)
    recorder = WardRecorder(files.Folder(tmp_path, WARD), WARD, replace(SETTINGS, keep_free_mb=0, **limits))
    recorder.begin(NOW, 0.0)
    recorder.tick(NOW, 0.0)
    there = {path.name for path in tmp_path.iterdir()}
    assert there >= set(others), "neither an unfinished file nor one of another ward or name"
    assert there & set(OLD) == set(left)
    said = [record.getMessage() for record in caplog.records if "is deleted" in record.getMessage()]
    assert len(said) == recorder.account.expired == len(OLD) - len(left)
    assert all(f"because of {why}" in words for words in said)
    recorder.close()


def test_the_file_under_way_counts_and_stays(tmp_path: Path) -> None:
    old_files(tmp_path, *OLD, size=3_000_000)
    recorder = WardRecorder(files.Folder(tmp_path, WARD), WARD, replace(SETTINGS, keep_free_mb=0, keep_gb=0.002))
    recorder.begin(NOW, 0.0)
    recorder.take([raw("chest", 0)], NOW, 0.0)
    recorder.tick(NOW, 0.0)
    (left,) = tmp_path.iterdir()
    assert left.suffix == files.PART
    recorder.close()
