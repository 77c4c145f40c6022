"""Flipped bits, torn files, backups and their rotation; the whole of it: `python -m tests.bench.store_faults`."""

import os
import random
import sqlite3
from pathlib import Path

import pytest

from estimator.database import SCHEMA_VERSION, Backups, Database, StoreError, backups, inspect
from estimator.service.store import Store
from estimator.service.store_reader import StoreReader
from tests.estimator.database.damage import Damaged, flipped
from tests.estimator.database.faults import full_disk
from tests.estimator.database.kept import CALIBRATIONS, loaded, made
from tests.estimator.stream import NAME


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> Damaged:
    return Damaged(tmp_path_factory.mktemp("damaged"))


@pytest.mark.parametrize("backup", [True, False])
def test_a_flipped_bit_is_found_or_does_no_harm(damaged: Damaged, *, backup: bool) -> None:
    chance, size = random.Random(1), len(damaged.whole)
    data = [flipped(damaged.whole, chance.randrange(size), chance.randrange(8)) for _ in range(60)]
    # Of the header: schema format to application id. Of a table's SQL: so that it is no text any more.
    data += [flipped(damaged.whole, byte, 3) for byte in range(44, 72)]
    data += [flipped(damaged.whole, damaged.whole.index(b"REAL NOT NULL"), 7)]
    found = {damaged.judge(one, backup=backup) for one in data}
    assert found == {"unharmed", "restored" if backup else "begun anew"}


@pytest.mark.parametrize("left", [0, 1, 15, 99, 100, 4095, 4096, 9000, -4096, -5000])
def test_a_torn_file_is_not_used(damaged: Damaged, left: int) -> None:
    assert damaged.judge(damaged.whole[:left]) == "restored"
    assert damaged.judge(damaged.whole[:left], backup=False) == "begun anew"


def test_another_file_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    (path := tmp_path / "text").write_text("this is no store " * 100)
    sqlite3.connect(other := tmp_path / "other.sqlite3").execute("CREATE TABLE calibrations (a)").connection.close()
    with sqlite3.connect(newer := made(tmp_path)) as db:
        db.execute("ALTER TABLE boots ADD COLUMN note TEXT")
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    db.close()
    for place, words in (
        (path, "is not a truerate store"),
        (other, "another program"),
        (newer, "use the version of truerate that wrote the store"),
    ):
        before = place.read_bytes()
        for opens in (Store, StoreReader.reading, inspect):
            with pytest.raises(StoreError, match=words):
                opens(place)
        assert place.read_bytes() == before


def test_what_goes_bad_while_it_is_in_use_is_put_right(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = made(tmp_path)
    before = StoreReader.reading(path)
    kept = loaded(before)
    before.close()
    store = Store(path, patient=True)
    store.database.back_up_if_due()
    data = path.read_bytes()
    path.write_bytes(data[:4096] + bytes(len(data) - 4096))
    assert store.calibrations(NAME) == [], "nothing of it is used"
    store.add_calibration(CALIBRATIONS[0])
    assert "is restored" in caplog.text
    assert loaded(store) == kept
    store.close()


def test_a_backup_a_day_and_the_newest_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backups, "KEEP", 3)
    store, kept = Store(made(tmp_path)), Backups.of(tmp_path / "a.sqlite3")
    for day in range(5):
        for _ in range(2):  # the second is not due
            store.database.back_up_if_due()
        for one in kept.newest_first():
            os.utime(one, (day, day))
    assert [one.name for one in kept.newest_first()] == [f"a-0000{n}.sqlite3" for n in (5, 4, 3)]
    assert all(inspect(one).sound for one in kept.newest_first())
    os.utime(kept.newest_first()[0], (4e9, 4e9))  # by a clock that was wrong
    store.database.back_up_if_due()
    assert kept.newest_first()[0].name == "a-00006.sqlite3"
    store.close()


def test_a_backup_that_cannot_be_made_is_said_and_the_store_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(made(tmp_path))
    with full_disk():
        store.database.back_up_if_due()
    assert "no backup of store" in caplog.text
    assert store.database.trouble == ""
    assert Backups.of(tmp_path / "a.sqlite3").newest_first() == []
    assert not list(tmp_path.glob("backups/*")), "no half of a copy is left"
    store.close()


def test_the_newest_sound_backup_is_restored_from_its_folder(tmp_path: Path) -> None:
    """Also where the store is missing, as after a crash in the midst of it; a log without its store is set aside."""
    path, folder = tmp_path / "ward" / "a.sqlite3", tmp_path / "stick"
    store = Store(Database(path, backups=folder))
    for n in range(3):
        store.add_calibration(CALIBRATIONS[n])
        Backups.of(path, folder).make()
    log = path.with_name("a.sqlite3-wal").read_bytes()
    store.close()
    (folder / "a-00003.sqlite3").write_bytes(b"SQLite format 3\0torn")
    path.unlink()
    path.with_name("a.sqlite3-wal").write_bytes(log)
    again = Store(Database(path, backups=folder))
    (note,) = again.database.notes
    assert "is missing; backup" in note
    assert "a-00003.sqlite3 is not restored" in note
    assert "a-00002.sqlite3 of" in note
    assert again.calibrations(NAME)[-1].id == CALIBRATIONS[1].id
    again.close()
