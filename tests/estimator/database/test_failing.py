"""A disk that is full, read-only or failing: what was acknowledged is there, what waits is written once it works again."""

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from estimator.database import Database, Unavailable, inspect
from estimator.service.store import Store
from estimator.service.store_reader import StoreReader
from estimator.service.store_writer import StoreWriter
from tests.estimator.database.faults import FailingCalls, full_disk
from tests.estimator.database.kept import CALIBRATIONS, bias, fill, loaded, made
from tests.estimator.stream import NAME, info

#: calls of SQLite in the session below, and some more
CALLS = 30


def test_a_disk_that_fills_up_and_is_emptied_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    store = Store(tmp_path / "a.sqlite3", patient=True)
    fill(store)
    kept = loaded(store)
    with full_disk():
        for _ in range(3):
            with pytest.raises(Unavailable, match="disk"):
                store.add_boot(info(7), 7)
        assert store.database.trouble
        assert loaded(store) == kept, "it can still be read"
    assert caplog.text.count("continues from memory") == 1
    store.add_boot(info(7), 7)
    assert store.database.trouble == ""
    assert caplog.text.count("works again") == 1
    assert loaded(store) == kept
    store.close()
    assert inspect(tmp_path / "a.sqlite3").sound


def test_a_store_that_may_only_be_read_is_read(tmp_path: Path) -> None:
    path, read_only = made(tmp_path), FailingCalls(1, 10**6, "attempt to write a readonly database")
    before = Store(path)
    kept = loaded(before)
    before.close()
    store = Store(Database(path, patient=True, connect=read_only))
    assert "readonly" in store.database.trouble
    assert loaded(store) == kept, "what is there is used"
    read_only.last = 0
    store.add_boot(info(7), 7)
    assert store.database.trouble == ""
    assert store.boots(NAME, 9)[-1] == 7, "who reads is in step with who writes"
    store.close()


@pytest.mark.parametrize("many", [1, 3])
@pytest.mark.parametrize("first", range(1, CALLS))
def test_whichever_call_fails_everything_is_written_in_the_end(tmp_path: Path, first: int, many: int) -> None:
    """In its order, and what is acknowledged is there at once, for another process too."""
    path, calls = tmp_path / "a.sqlite3", FailingCalls(first, many)
    store = Store(Database(path, patient=True, connect=calls))
    clerk, acknowledged = StoreWriter(store.database, thread=False), list[str]()
    for n in range(1, 5):
        c = replace(CALIBRATIONS[0], id=f"c{n}", boot=n)
        clerk.do(lambda c=c: store.add_calibration(c), lambda error, c=c: acknowledged.append(f"{c.id} {error}"))  # type: ignore[misc]
        clerk.do(lambda n=n: store.save_bias(NAME, n, n, bias(n), history=True))  # type: ignore[misc]
        if acknowledged:
            other = StoreReader.reading(path)
            assert [f"{c.id} None" for c in other.calibrations(NAME)] == acknowledged
            other.close()
    for _ in range(many + 2):
        clerk.collect()
    assert acknowledged == [f"c{n} None" for n in range(1, 5)]
    assert calls.calls > CALLS - 2, "each call of the session was tried"
    clerk.close()
    store.close()
    again = Store(path)
    assert [c.id for c in again.calibrations(NAME)] == ["c1", "c2", "c3", "c4"]
    assert len(again.database.rows("bias_history")) == 4
    assert again.database.notes == []
    again.close()


def killed(path: Path, lines: int, number: int) -> set[int]:
    """The numbers of calibrations that a writer had acknowledged when it was killed, after so many of them."""
    words = [sys.executable, "-m", "tests.estimator.database.writing", str(path), str(number)]
    writer = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    killer = threading.Timer(60.0, writer.kill)
    killer.start()
    said: list[str] = []
    for line in writer.stdout:
        said.append(line)
        if len(said) == lines:
            writer.kill()  # whatever it is doing
    killer.cancel()
    writer.wait()
    writer.stdout.close()
    assert len(said) >= lines
    return {int(line) for line in said if line.endswith("\n")}


def test_killed_while_writing_nothing_that_was_acknowledged_is_lost(tmp_path: Path) -> None:
    path, acknowledged = tmp_path / "a.sqlite3", set[int]()
    for kill in range(2):
        acknowledged |= killed(path, 20 + 7 * kill, 1000 * kill)
        store = Store(path)
        assert acknowledged <= {c.boot for c in store.calibrations(NAME)}
        assert store.database.notes == []
        store.close()
    assert len(acknowledged) >= 40
