"""A backup put in the place of a store, as a person does it: with `cp`, beside what was there, with rights of somebody else."""

import errno
import os
import sqlite3
from pathlib import Path

import pytest

from estimator.database import Database, Unavailable, inspect
from estimator.database.connection import connect
from estimator.service.store import Store
from tests.estimator.database.kept import CALIBRATIONS, bias, fill, loaded
from tests.estimator.stream import NAME, info


def copied(source: Path, target: Path, *tails: str) -> None:
    for tail in ("", *tails):
        target.with_name(target.name + tail).write_bytes(source.with_name(source.name + tail).read_bytes())


@pytest.fixture
def restored(tmp_path: Path) -> tuple[Path, set[object]]:
    """A backup in the place of the store of an estimator that was killed, with that one's log; what the backup has."""
    live = Store(tmp_path / "live.sqlite3")
    fill(live)
    kept, backup = loaded(live), tmp_path / "backup.sqlite3"
    live.database.backup(backup)
    for boot in range(4, 40):
        live.add_boot(info(boot), boot)
        for minute in range(20):
            live.save_bias(NAME, boot, 60 * boot + minute, bias(boot), history=True)
    place = tmp_path / "ward" / "a.sqlite3"
    place.parent.mkdir()
    copied(tmp_path / "live.sqlite3", place, "-wal")
    live.close()
    copied(backup, place)
    return place, kept


def test_the_log_of_what_was_there_is_not_written_into_a_backup(restored: tuple[Path, set[object]]) -> None:
    path, kept = restored
    found = inspect(path)
    assert found.sound
    assert found.notes == ["the log beside it is of the file that was there before, and is not used"]
    reader = Store.reading(path)
    assert loaded(reader) == kept, "nor is it taken for a part of it"
    reader.close()
    log = path.with_name(path.name + "-wal").read_bytes()
    store = Store(path)
    assert loaded(store) == kept
    (note,) = store.database.notes
    assert "is of the file that was there before" in note
    store.add_calibration(CALIBRATIONS[0])
    store.close()
    assert [aside.read_bytes() for aside in path.parent.glob("a.sqlite3.log-*")] == [log]
    again = Store(path)
    assert loaded(again) == kept
    assert again.database.notes == []
    again.close()


def test_the_log_beside_an_empty_file_is_kept(restored: tuple[Path, set[object]]) -> None:
    """As `cp` leaves it on a full disk; SQLite removes such a log."""
    path, _ = restored
    path.write_bytes(b"")
    log = path.with_name(path.name + "-wal").read_bytes()
    store = Store(path)
    (note,) = store.database.notes
    (aside,) = path.parent.glob("a.sqlite3.log-*")
    assert note.endswith(f"is kept as {aside}")
    assert aside.read_bytes() == log
    store.close()


def test_what_is_replaced_under_an_estimator_is_not_touched(
    restored: tuple[Path, set[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = restored
    monkeypatch.setattr("estimator.database.rescue.used", lambda _: True)
    before = {file.name: file.read_bytes() for file in path.parent.iterdir()}
    with pytest.raises(Unavailable, match="was replaced while another process has it open: stop that"):
        Database(path)
    assert {file.name: file.read_bytes() for file in path.parent.iterdir()} == before


def test_a_store_that_cannot_be_written_is_known_before_there_is_something_to_write(
    restored: tuple[Path, set[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, kept = restored
    Store(path).close()
    only_read = lambda place: connect(f"{Path(place).absolute().as_uri()}?mode=ro", uri=True)  # noqa: E731
    with monkeypatch.context() as patch:
        patch.setattr("estimator.database.opening.connect", only_read)
        store = Store(path, patient=True)
        assert "readonly" in store.database.trouble
        assert "is it this user's to write?" in store.database.trouble
        assert loaded(store) == kept
        store.close()


def test_why_there_can_be_no_copy_is_said_in_the_systems_words(
    restored: tuple[Path, set[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = restored
    reader = Database.reading(path)

    def refused(place: Path, *_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(place))

    monkeypatch.setattr(Path, "touch", refused)
    with pytest.raises(Unavailable, match="on a disk that can only be read"):
        reader.backup(path.with_name("copy.sqlite3"))
    reader.close()


def test_a_store_of_a_newer_truerate_is_left_alone(restored: tuple[Path, set[object]]) -> None:
    path, _ = restored
    Store(path).close()
    db = sqlite3.connect(path)
    db.execute("ALTER TABLE boots ADD COLUMN note TEXT")
    db.execute("PRAGMA user_version = 99")
    db.close()
    before = path.read_bytes()
    for opens in (Store, Store.reading, inspect):
        with pytest.raises(Exception, match="has schema 99, this truerate knows 2: update truerate"):
            opens(path)
    assert path.read_bytes() == before
