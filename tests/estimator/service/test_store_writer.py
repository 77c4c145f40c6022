"""A disk that takes its time: samples do not wait for it, calibrations are said when they are kept, nothing is lost."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from bridge.wire import codec, keys
from bridge.wire.messages import Command, Quality
from estimator.database import Database, StoreError
from estimator.service import store_access
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter
from tests.estimator.memory_ward import WARD, Ward
from tests.estimator.stream import NAME, calibration, info


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    made = Store(tmp_path / "a.sqlite3")
    yield made
    made.close()


class Busy:
    """A ward whose estimator has a clerk, and whose store another program has locked until `free`."""

    def __init__(self, folder: Path) -> None:
        self.ward = Ward(folder)
        self.ward.kill()
        self.clerks: list[StoreWriter] = []
        self.ward.start(self._hired)
        self._other = sqlite3.connect(self.ward.path, isolation_level=None)
        self._other.execute("BEGIN IMMEDIATE")  # whoever writes now waits

    def _hired(self, database: Database) -> StoreWriter:
        database.execute("PRAGMA busy_timeout = 60000")
        self.clerks.append(StoreWriter(database))
        return self.clerks[0]

    def free(self) -> None:
        self._other.close()


@pytest.fixture
def busy(tmp_path: Path) -> Iterator[Busy]:
    made = Busy(tmp_path)
    yield made
    made.free()
    made.clerks[0].close()
    made.ward.kill()


def test_a_calibration_and_what_names_it_is_said_when_it_is_kept(busy: Busy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_access, "HELD_S", 60.0)
    ward, stream = busy.ward, calibration(seed=1)
    ward.send(stream.batches(), info(1))
    before = list(ward.subscriber)
    assert before
    assert Quality.GOOD not in {batch.quality for batch in before}
    assert ward.client.calibrations(wait_s=0.05) == [], "promised to nobody yet"
    assert not ward.latest().calibration
    assert ward.store.recall(NAME, 1, 0) is None, "to read waits for nobody"
    busy.free()
    deadline = time.monotonic() + 60
    while not (said := ward.client.calibrations(wait_s=0.05)) and time.monotonic() < deadline:
        ward.settle()
    batches = before + list(ward.subscriber)
    assert sum(map(len, batches)) == len(stream)
    assert batches[-1].quality is Quality.GOOD
    assert [c.id for c in said] == [c.id for c in ward.store.calibrations(NAME)] == [batches[-1].calibration]
    assert ward.latest().calibration == said[0].id
    assert ward.store.database.failures == 0
    busy.clerks[0].close()
    assert (found := ward.store.recall(NAME, 1, 0)) is not None
    assert found.bias is not None


def test_no_sample_waits_long_for_a_disk_that_does_not_answer(busy: Busy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_access, "HELD_S", 0.0)
    ward, stream = busy.ward, calibration(seed=1)
    ward.send(stream.batches(), info(1))
    batches = list(ward.subscriber)
    assert sum(map(len, batches)) == len(stream)
    assert batches[-1].quality is Quality.GOOD
    assert [c.id for c in ward.client.calibrations(wait_s=0.05)] == [batches[-1].calibration]


def test_who_was_answered_can_rely_on_it_unless_the_disk_does_not_answer(
    busy: Busy, monkeypatch: pytest.MonkeyPatch
) -> None:
    ward = busy.ward
    ward.send(calibration(seed=1).batches()[:60], info(1))
    monkeypatch.setattr(store_access, "HELD_S", 0.1)
    assert ward.command(lambda: ward.client.note(NAME, "nurse", "she lay down")).accepted
    busy.free()
    monkeypatch.setattr(store_access, "HELD_S", 60.0)
    assert ward.command(lambda: ward.client.note(NAME, "nurse", "she stood up")).accepted
    assert [line["reason"] for line in ward.store.database.rows("audit", "verb = 'note'", ())][-1] == "she stood up"


def test_a_command_and_its_repeat_are_answered_once_it_is_written_down(
    busy: Busy, monkeypatch: pytest.MonkeyPatch
) -> None:
    ward, replies = busy.ward, list[bytes]()
    ward.send(calibration(seed=1).batches()[:60], info(1))
    monkeypatch.setattr(store_access, "HELD_S", 60.0)
    key = keys.build(WARD, "rpc", device=NAME, verb="note")
    for _ in range(2):
        ward.service._commands.ask(key, codec.encode_command(Command("r1", "nurse", "she lay down")), replies.append)
    for _ in range(20):
        ward.service.step(0.01)
    assert replies == []
    busy.free()
    while len(replies) < 2:
        ward.service.step(0.01)
    assert replies[0] == replies[1]
    assert len(ward.store.database.rows("audit", "verb = 'note'", ())) == 1


def test_what_cannot_be_written_at_the_end_is_told(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    store.database.execute("PRAGMA busy_timeout = 50")
    clerk, heard = StoreWriter(store.database), list[StoreError | None]()
    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        for _ in range(4):
            clerk.do(lambda: store.save_epoch(1), heard.append)
        clerk.close()
    assert len(heard) == 4
    assert all("does not answer" in str(error) for error in heard)
    assert "the last entries are lost" in caplog.text
