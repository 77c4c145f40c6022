"""What stands where a file is to be written: nothing of others is written through, and what cannot be used is said."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.recording import Recording
from bridge.recording.error import RecordingError
from bridge.recording.files import Folder, new_file
from bridge.recording.recorder import WardRecorder
from bridge.recording.settings import Recorder
from bridge.wire import codec, keys
from estimator.database import StoreError
from estimator.offline import corrected_file
from estimator.offline.recordings import correct
from estimator.service.store import Store
from tests.bridge.recording.crowd import WARD, samples
from tests.estimator.device.test_correction import CALIBRATION

PRECIOUS = "of somebody else"


def corrected(path: Path) -> None:
    n = 200
    recording = Recording(np.arange(n) / 100.0, np.zeros((n, 3)), None, None, 100.0, "chest")
    corrected_file.save(path, correct(recording, CALIBRATION), recording)


def exported(path: Path) -> None:
    with new_file(path) as file:
        file.write(b"{}")


def backup(path: Path) -> None:
    from estimator.database.backups import back_up

    store = path.with_name("store.sqlite3")
    if not store.exists():
        kept = Store(store)
        kept.add_calibration(CALIBRATION)
        kept.close()
    back_up(store, path)


#: each writer, with the name of its file and that of the file it writes first
WRITERS = [
    (corrected, "c.csv", ".c.csv.new"),
    (exported, "e.json", ".e.json.new"),
    (backup, "b.sqlite3", "b.sqlite3.part"),
]


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    (made := tmp_path / "precious").write_text(PRECIOUS)
    return made


@pytest.mark.parametrize(("write", "name", "first"), WRITERS)
@pytest.mark.parametrize("link", [os.symlink, os.link, lambda _, to: os.mkfifo(to)], ids=["symbolic", "hard", "pipe"])
def test_a_link_or_pipe_where_a_file_is_written_first_is_replaced_at_once(
    tmp_path: Path,
    precious: Path,
    write: Callable[[Path], None],
    name: str,
    first: str,
    link: Callable[[Path, Path], None],
) -> None:
    link(precious, tmp_path / first)
    write(tmp_path / name)
    assert (tmp_path / name).is_file()
    assert (tmp_path / name).stat().st_size
    assert not (tmp_path / first).exists()
    assert precious.read_text() == PRECIOUS


@pytest.mark.parametrize(("write", "name", "first"), WRITERS)
def test_a_folder_where_a_file_is_written_first_is_said_and_left_alone(
    tmp_path: Path, write: Callable[[Path], None], name: str, first: str
) -> None:
    (tmp_path / first).mkdir()
    (tmp_path / first / "theirs").touch()
    with pytest.raises((OSError, StoreError, RecordingError), match=r"folder|directory"):
        write(tmp_path / name)
    assert (tmp_path / first / "theirs").exists()
    assert not (tmp_path / name).exists()


def test_a_recording_that_is_removed_while_it_is_written_is_said_and_begun_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    recorder = WardRecorder(Folder(tmp_path, WARD), WARD, Recorder())
    recorder.begin(time.time_ns(), 0.0)
    key = keys.build(WARD, "raw", bridge="bridge-1", device="one")
    for second in range(4):
        message = Message(key, codec.encode_samples(samples("one", 5 * second, 5, time.time_ns())))
        recorder.take([message], time.time_ns(), float(second))
        if second == 1:
            (part,) = tmp_path.iterdir()
            part.unlink()
        recorder.tick(time.time_ns(), second + 0.9)
        recorder.tick(time.time_ns(), second + 0.95)
    recorder.close()
    assert "was removed while it was being written" in caplog.text
    assert recorder.account.files == list(tmp_path.iterdir())
    (again,) = tmp_path.iterdir()
    assert again.suffix == ".mcap"
