"""A store of an earlier schema is brought to the present one, with a backup before, or left as it was."""

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.wire import keys
from estimator.database import SCHEMA_VERSION, Change, inspect, schema
from estimator.database.connection import connect
from estimator.service.store import Store, StoreError
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
from tests.estimator.database.kept import CALIBRATIONS, fill, loaded
from tests.estimator.stream import NAME, Stream, info


def old(path: Path) -> set[object]:
    """A store of schema 1, as the estimator of that time wrote it; what is in it."""
    present = Store(path)
    fill(present)
    kept = loaded(present)
    rows = {table: present.database.rows(table) for table in schema.TABLES}
    present.close()
    path.unlink()
    db = connect(str(path))
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("BEGIN")
    schema.build(db, 1)
    for table, found in rows.items():
        for row in found:
            row.pop("version", None)
            if table in ("calibrations", "bias"):
                row["digest"] = schema._old_digest(row.get("payload", row.get("state")))
            places = ", ".join("?" * len(row))
            db.execute(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({places})", tuple(row.values()))
    db.execute("COMMIT")
    db.close()
    return kept


def version(path: Path) -> int:
    db = sqlite3.connect(path)
    found = int(db.execute("PRAGMA user_version").fetchone()[0])
    db.close()
    return found


@pytest.mark.parametrize("unmarked", [False, True], ids=["", "as the very first wrote it"])
def test_everything_is_there_afterwards_and_sealed(tmp_path: Path, unmarked: bool) -> None:
    path = tmp_path / "a.sqlite3"
    kept = old(path)
    if unmarked:
        db = sqlite3.connect(path)
        db.execute("PRAGMA application_id = 0")
        db.close()
    found = inspect(path)
    assert (found.schema, found.sound, found.whole["calibrations"]) == (1, True, 3)
    assert "earlier truerate" in found.notes[0]
    store = Store(path)
    assert loaded(store) == kept
    store.close()
    assert version(path) == SCHEMA_VERSION
    assert inspect(path).sound
    before = tmp_path / "a.sqlite3.schema-1"
    assert version(before) == 1
    assert not before.with_name(before.name + "-wal").exists(), "the backup stands alone"


#: as each truerate kept the latest bias of a boot: states, covariance, device time, temperature, and what it knew beside
_THREE, _SIX, _MANY = ([n * [0.1], np.eye(n).tolist(), 5.0, 25.0] for n in (3, 6, 72))


@pytest.mark.parametrize(
    ("kept", "used"),
    [
        ([*_THREE, None], False),
        ([*_THREE, 24.0], False),
        ([*_THREE, 24.0, 1.5], False),
        ([*_SIX, None], True),
        ([*_MANY, 3.0], True),
        ([*_MANY, 3.0, {"doubted": True, "asked": None}], True),
        ([*_SIX, 3.0, {"doubted": True, "asked": ["nurse", "strap"]}], True),
    ],
)
def test_a_bias_as_any_truerate_kept_it_is_gone_on_with_or_left(
    tmp_path: Path, kept: list[object], used: bool, once: Stream
) -> None:
    store = Store(tmp_path / "a.sqlite3")
    store.add_boot(info(1), 1)
    calibration = replace(CALIBRATIONS[0], boot=1)
    store.add_calibration(calibration)
    row = {"device": NAME, "boot": keys.boot_id(1), "time_ns": 7, "state": json.dumps(kept)}
    store.database.write(Change("bias", row, "REPLACE"))
    remembered = store.recall(NAME, 1, 100)
    assert remembered is not None
    assert remembered.calibration is not None
    assert (remembered.bias is not None) is used
    session = DeviceSession(NAME, SessionKnobs())
    session.begin_boot(1, 6.0, remembered)
    assert session.calibration is not None
    assert [session.handle(batch) for batch in once.batches()[:20]]
    store.close()


def test_what_was_damaged_before_stays_refused(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.sqlite3"
    old(path)
    other = sqlite3.connect(path)
    with other:
        other.execute("UPDATE calibrations SET payload = x'01' WHERE id = 'c3'")
        other.execute("UPDATE calibrations SET boot = '0000000000000009' WHERE id = 'c2'")
    other.close()
    store = Store(path)
    assert [c.id for c in store.calibrations("chest")] == ["c1"]
    assert "row 3 of calibrations is damaged" in caplog.text
    assert "c2: its columns are not those of its content" in caplog.text
    assert store.recall("chest", 9, 0) is None
    store.close()


@pytest.mark.parametrize("statement", range(1, 40, 3))
def test_a_migration_that_fails_changes_nothing(
    tmp_path: Path, statement: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.sqlite3"
    kept = old(path)
    done = 0
    seal_everything = schema.MIGRATIONS[1]

    class Failing:
        def __init__(self, db: schema.Connection) -> None:
            self.db = db

        def execute(self, *words: object) -> object:
            nonlocal done
            done += 1
            if done == statement:
                raise sqlite3.OperationalError("database or disk is full")
            return self.db.execute(*words)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        failing = (schema.MIGRATIONS[0], lambda db: seal_everything(Failing(db)))  # type: ignore[arg-type]
        patch.setattr("estimator.database.opening.MIGRATIONS", failing)
        with pytest.raises(StoreError, match="disk is full"):
            Store(path)
    assert version(path) == 1
    assert not list(tmp_path.glob("*.schema-*")), "or each try would leave one"
    store = Store(path)
    assert loaded(store) == kept
    store.close()


def test_a_disk_without_room_for_the_backup_leaves_the_store_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.sqlite3"
    kept = old(path)

    def full(*_: object) -> None:
        raise OSError("No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("estimator.database.opening.replaced", full)
        with pytest.raises(StoreError, match="cannot be copied"):
            Store(path)
    assert version(path) == 1
    reader = Store.reading(path)
    assert loaded(reader) == kept, "an old store can be read as it is"
    reader.close()
    assert version(path) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.sqlite3"]


def test_a_damaged_store_of_the_first_schema_is_put_right_and_brought_up(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite3"
    kept = old(path)
    data = bytearray(path.read_bytes())
    data[20:24] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    store = Store(path)
    assert loaded(store) == kept
    store.close()
    assert version(path) == SCHEMA_VERSION
