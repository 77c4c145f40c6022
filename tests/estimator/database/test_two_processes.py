"""Two processes on one store: nothing is taken from under who has it open, and no copy is made of what he is writing."""

import contextlib
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from estimator.database import Unavailable, connection
from estimator.database.database import RETRY_S
from estimator.service.store import Store
from tests.estimator.database.kept import loaded, made
from tests.estimator.stream import NAME

#: one row before the line that it waits for, one after
_OTHER = f"""
import sys
from estimator.service.store import Store
store = Store(sys.argv[1])
for request in ("before", "after"):
    store.add_audit(9, {NAME!r}, "note", request, "nurse", "", "noted", accepted=True)
    print(request, flush=True)
    sys.stdin.readline()
store.close()
"""
#: what another process finds of a row
_ASK = f"""
import sys
from estimator.service.store import Store
print(Store.reading(sys.argv[1]).answer({NAME!r}, "note", "again"))
"""


@contextlib.contextmanager
def another(path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has the store open, and has written one row."""
    words = [sys.executable, "-c", _OTHER, str(path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "before\n"
        yield process
        process.communicate("\n\n", timeout=30)


def broken(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(20)
        file.write(b"\xff" * 4)  # of the header: every row is whole


def test_a_damaged_store_is_not_replaced_under_who_writes_to_it(tmp_path: Path) -> None:
    path = made(tmp_path)
    with another(path):
        broken(path)
        with pytest.raises(Unavailable, match="another process has it open"):
            Store(path)
        patient = Store(path, patient=True)
        assert "another process has it open" in patient.database.trouble
    assert not list(tmp_path.glob("*.damaged-*"))
    patient.database._again_s -= RETRY_S
    patient.database.probe()
    for request in ("before", "after"):
        assert patient.answer(NAME, "note", request) == (True, "noted"), request
    patient.close()


def test_who_has_it_again_after_a_failure_is_not_taken_for_gone_by_who_ends(tmp_path: Path) -> None:
    """Else that one takes the log with it, and what is written then is nowhere."""
    path = made(tmp_path)
    with another(path):
        store = Store(path, patient=True)
        store.database._gone("the disk failed")
        store.database._again_s -= RETRY_S
        store.database.probe()
    store.add_audit(9, NAME, "note", "again", "nurse", "", "noted", accepted=True)
    words = [sys.executable, "-c", _ASK, str(path)]
    found = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout == "(True, 'noted')\n"
    store.close()


def test_what_could_be_read_stays_where_the_file_cannot_be_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path)
    with another(path):
        store = Store(path, patient=True)
        kept = loaded(store)
        store.database._gone("the disk failed")
        with monkeypatch.context() as patch:
            patch.setattr("estimator.database.database.open_store", failing)
            for _ in range(2):
                store.database._again_s -= RETRY_S
                with pytest.raises(Unavailable, match="failing still"):
                    store.database.probe()
                assert loaded(store) == kept
        store.database._again_s -= RETRY_S
        store.database.probe()
        assert loaded(store) == kept
        store.close()


def failing(_: Path) -> None:
    raise Unavailable("failing still")


def test_what_another_is_writing_just_now_is_not_lost(tmp_path: Path) -> None:
    path = made(tmp_path)
    with another(path):
        with path.with_name("a.sqlite3-wal").open("ab") as log:  # the beginning of a frame, as it would be written
            log.write(log_head(path) + bytes(4096))
        store = Store(path)
        assert store.database.notes == []
        store.close()
    assert not list(tmp_path.glob("*.damaged-*"))


def test_what_is_copied_while_somebody_begins_to_write_is_copied_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, begun = made(tmp_path), list[Store]()

    def just_then(place: Path) -> sqlite3.Connection:
        opened = beside(place)
        if not begun:
            begun.append(Store(path))
            begun[0].add_audit(9, NAME, "note", "meanwhile", "nurse", "", "noted", accepted=True)
        return opened

    beside = connection.beside
    monkeypatch.setattr(connection, "beside", just_then)
    reading = Store.reading(path)
    assert reading.answer(NAME, "note", "meanwhile") == (True, "noted")
    reading.close()
    begun[0].close()


def log_head(path: Path) -> bytes:
    """Of a frame of the present log, with sums that are not right yet."""
    salts = path.with_name("a.sqlite3-wal").read_bytes()[16:24]
    return b"\0\0\0\1" * 2 + salts + bytes(8)


@pytest.fixture
def torn(tmp_path: Path) -> Path:
    """A store whose log was damaged when nobody had it open."""
    path = made(tmp_path / "made")
    store = Store(path)
    store.add_audit(9, NAME, "note", "last", "nurse", "", "noted", accepted=True)
    file, log = path.read_bytes(), bytearray(path.with_name("a.sqlite3-wal").read_bytes())
    store.close()
    log[-9] ^= 1
    (again := tmp_path / "again").mkdir()
    (again / "a.sqlite3").write_bytes(file)
    (again / "a.sqlite3-wal").write_bytes(log)
    return again / "a.sqlite3"


def test_a_full_disk_is_not_filled_with_halves_of_copies(torn: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: Path, to: Path) -> None:
        to.write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("estimator.database.rescue.shutil.copyfile", full)
    with pytest.raises(Unavailable, match="the disk is full"):
        Store(torn)
    assert not list(torn.parent.glob("*.damaged-*"))


def test_of_the_same_damage_one_copy_is_kept_however_often_it_is_tried(
    torn: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(_: Path) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("estimator.database.opening._opened", failing)
        for second in range(3):
            patch.setattr("estimator.database.rescue.time.strftime", lambda *_, at=second: f"2026030{at}T000000Z")
            with pytest.raises(Unavailable):
                Store(torn)
    assert len(list(torn.parent.glob("*.damaged-*"))) == 2  # the file and its log
    store = Store(torn)
    assert len(store.database.notes) == 1
    store.close()
