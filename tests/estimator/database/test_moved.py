"""The store's file is removed or replaced while it is in use, or reached by another name."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from estimator.cli.main import main
from estimator.database import Database, StoreError
from estimator.service.store import Store
from tests.estimator.database.kept import CALIBRATIONS
from tests.estimator.stream import NAME

_HOLD = """
import sys
from estimator.database import Database
Database(sys.argv[1], patient=True, alone=True)
print("mine", flush=True)
sys.stdin.read()
"""


def removed(path: Path) -> None:
    path.unlink()


def replaced(path: Path) -> None:
    other = path.with_name("other.sqlite3")
    Store(other).close()
    other.replace(path)


def folder_removed(path: Path) -> None:
    shutil.rmtree(path.parent)


@pytest.mark.parametrize("do", [removed, replaced, folder_removed])
def test_what_was_acknowledged_is_kept_and_it_is_said(tmp_path: Path, do: Callable[[Path], None]) -> None:
    path = tmp_path / "stores" / "a.sqlite3"
    store = Store(Database(path, patient=True, alone=True))
    store.add_calibration(CALIBRATIONS[0])
    do(path)
    store.add_calibration(CALIBRATIONS[1])
    store.database.look()
    assert "was removed or replaced while it is in use" in store.database.trouble
    store.add_calibration(CALIBRATIONS[2])
    assert store.database.trouble == ""
    (note,) = store.database.notes
    assert "is written anew" in note
    assert "is kept as" in note or do is not replaced
    store.database.look()
    assert store.database.trouble == ""
    store.close()
    again = Store(path)
    assert [c.id for c in again.calibrations(NAME)] == ["c1", "c2", "c3"]
    again.close()


def other_process(path: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_a_link_is_no_way_around_the_lock(tmp_path: Path, link: Callable[[Path, Path], None]) -> None:
    path, alias = tmp_path / "a.sqlite3", tmp_path / "alias.sqlite3"
    store = Store(path)
    store.add_calibration(CALIBRATIONS[0])
    store.close()
    link(path, alias)
    with other_process(path) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "mine\n"
        with pytest.raises(StoreError, match="another estimator uses it: give each estimator its own store"):
            Database(alias, patient=True, alone=True)
        (tmp_path / "a.sqlite3.lock").unlink(missing_ok=True)
        assert main(["store", "backup", str(tmp_path / "b.sqlite3"), "--store", str(path)]) == 0
        assert main(["store", "restore", str(tmp_path / "b.sqlite3"), "--store", str(path)]) == 1
    Database(alias, patient=True, alone=True).close()


def test_a_store_that_another_estimator_has_begun_in_its_place_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite3"
    store = Store(Database(path, patient=True, alone=True))
    store.add_calibration(CALIBRATIONS[0])
    path.unlink()
    with other_process(path) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "mine\n"
        inode = path.stat().st_ino
        store.database.look()
        with pytest.raises(StoreError, match="another estimator uses it"):
            store.add_calibration(CALIBRATIONS[1])
        assert path.stat().st_ino == inode
        assert store.database.trouble
    store.add_calibration(CALIBRATIONS[1])
    assert [c.id for c in store.calibrations(NAME)] == ["c1", "c2"]
    store.close()


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(path := tmp_path / "a.sqlite3")
    with pytest.raises(StoreError, match="is not a regular file"):
        Database(path, patient=True)


def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    from estimator.database.owner import owned

    (precious := tmp_path / "precious").write_text("of somebody else")
    (tmp_path / "a.sqlite3.lock").symlink_to(precious)
    with pytest.raises(StoreError, match="is a symbolic link"), owned(str(tmp_path / "a.sqlite3")):
        pass
    assert precious.read_text() == "of somebody else"


def test_backups_and_new_stores_are_not_written_through_a_link(tmp_path: Path) -> None:
    (precious := tmp_path / "precious").write_text("of somebody else")
    (tmp_path / "a.sqlite3.part").symlink_to(precious)
    store = Store(tmp_path / "a.sqlite3")
    store.add_calibration(CALIBRATIONS[0])
    (tmp_path / "backups").mkdir()
    (tmp_path / "backups" / "a-00001.sqlite3.part").symlink_to(precious)
    store.database.back_up_if_due()
    assert (tmp_path / "backups" / "a-00001.sqlite3").exists()
    store.close()
    assert precious.read_text() == "of somebody else"
