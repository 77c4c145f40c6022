"""A disk that takes its time: samples do not wait for it, calibrations are said when they are kept, nothing is lost."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest

from bridge.wire import keys
from bridge.wire.messages import Command, CommandReply, Quality
from bridge.wire.refusal import Tally
from estimator.database import Database, StoreError
from estimator.service import clerk as rules
from estimator.service import record
from estimator.service.clerk import Clerk, Done, Inline, Write
from estimator.service.store import Store
from tests.estimator.database.kept import CALIBRATIONS
from tests.estimator.memory_ward import Ward
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
        self.clerks: list[Clerk] = []
        self.ward.start(self._hired)
        self._other = sqlite3.connect(self.ward.path, isolation_level=None)
        self._other.execute("BEGIN IMMEDIATE")  # whoever writes now waits

    def _hired(self, database: Database) -> Clerk:
        self.clerks.append(Clerk(database))
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
    monkeypatch.setattr(record, "HELD_S", 60.0)
    ward, stream = busy.ward, calibration(seed=1)
    ward.send(stream.batches(), info(1))
    before = list(ward.subscriber)
    assert before
    assert Quality.GOOD not in {batch.quality for batch in before}
    assert ward.client.calibrations(wait_s=0.05) == [], "promised to nobody yet"
    assert not ward.latest().calibration
    assert ward.store.recall(NAME, 1, 0) is None, "to read waits for nobody"
    busy.free()
    deadline = time.monotonic() + 20
    while not (said := ward.client.calibrations(wait_s=0.05)) and time.monotonic() < deadline:
        ward.settle()
    batches = before + list(ward.subscriber)
    assert sum(map(len, batches)) == len(stream)
    assert batches[-1].quality is Quality.GOOD
    assert [c.id for c in said] == [c.id for c in ward.store.calibrations(NAME)] == [batches[-1].calibration]
    assert ward.latest().calibration == said[0].id
    assert ward.service.counts.as_dict() == {}
    busy.clerks[0].close()
    assert (found := ward.store.recall(NAME, 1, 0)) is not None
    assert found.bias is not None


def test_no_sample_waits_long_for_a_disk_that_does_not_answer(busy: Busy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "HELD_S", 0.0)
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
    monkeypatch.setattr(record, "HELD_S", 0.1)
    assert ward.command(lambda: ward.client.note(NAME, "nurse", "she lay down")).accepted
    monkeypatch.setattr(record, "HELD_S", 60.0)
    unknown = ward.command(lambda: ward.client.note(NAME, "nurse", "she sat up"))
    assert (unknown.accepted, "how it ended is not known" in unknown.message) == (False, True)
    busy.free()
    assert ward.command(lambda: ward.client.note(NAME, "nurse", "she stood up")).accepted
    assert [line["reason"] for line in ward.store.database.rows("audit", "verb = 'note'", ())][-1] == "she stood up"


def test_one_that_cannot_be_written_keeps_the_others_from_nothing(store: Store) -> None:
    clerk, heard = Clerk(store.database), list[StoreError | None]()
    bad = replace(CALIBRATIONS[0], id=None)  # type: ignore[arg-type]
    for c in (CALIBRATIONS[0], bad, CALIBRATIONS[1]):
        clerk.do(lambda c=c: store.add_calibration(c), heard.append)  # type: ignore[misc]
    assert heard == [], "told only in collect"
    clerk.close()
    assert [error is None for error in heard] == [True, False, True]
    assert [c.id for c in store.calibrations(NAME)] == ["c1", "c2"]


def test_more_than_can_wait_is_refused(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "MOST", 3)
    heard = list[StoreError | None]()
    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        clerk = Clerk(store.database)
        for _ in range(20):
            clerk.do(lambda: store.add_calibration(CALIBRATIONS[0]), heard.append)
        assert heard
        assert all("too slow" in str(error) for error in heard)
        other.execute("COMMIT")
    clerk.close()
    assert len(heard) == 20
    assert None in heard


class Counted:
    """A clerk, and how many writes it was given were in each of its transactions."""

    def __init__(self, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
        self.transactions, together = [0], store.database.together

        @contextmanager
        def counted() -> Iterator[None]:
            self.transactions.append(0)
            with together():
                yield

        monkeypatch.setattr(store.database, "together", counted)
        self.heard = list[StoreError | None]()
        self.clerk = Clerk(store.database)

    def give(self, *, soon: bool) -> None:
        self.clerk.do(self._write, self.heard.append, soon=soon)

    def _write(self) -> None:
        self.transactions[-1] += 1

    def close(self) -> list[int]:
        self.clerk.close()
        assert self.heard == [None] * sum(self.transactions)
        return self.transactions[1:]


def test_what_need_not_be_written_soon_is_written_together(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a thousand devices two hundred writes a second waited for the disk one by one."""
    monkeypatch.setattr(rules, "GATHER_S", 30.0)
    counted = Counted(store, monkeypatch)
    for _ in range(5):
        counted.give(soon=False)
        time.sleep(0.02)
    assert counted.close() == [5]


def test_what_is_to_be_written_soon_takes_along_what_waits(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "GATHER_S", 30.0)
    counted = Counted(store, monkeypatch)
    for soon in (False, False, True):
        counted.give(soon=soon)
    deadline = time.monotonic() + 20
    while len(counted.heard) < 3 and time.monotonic() < deadline:
        counted.clerk.collect()
        time.sleep(0.01)
    assert len(counted.heard) == 3
    assert sum(counted.close()) == 3


def test_nothing_waits_for_more_for_ever(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = Counted(store, monkeypatch)
    counted.give(soon=False)
    deadline = time.monotonic() + 20
    while not counted.heard and time.monotonic() < deadline:
        counted.clerk.collect()
        time.sleep(0.01)
    assert counted.heard == [None]
    assert counted.close() == [1]


def test_many_that_wait_are_not_kept_until_it_is_time(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "GATHER_S", 30.0)
    monkeypatch.setattr(rules, "TOGETHER", 4)
    counted = Counted(store, monkeypatch)
    for _ in range(9):
        counted.give(soon=False)
    deadline = time.monotonic() + 20
    while len(counted.heard) < 8 and time.monotonic() < deadline:
        counted.clerk.collect()
        time.sleep(0.01)
    assert len(counted.heard) >= 8
    assert counted.close() == [4, 4, 1]


def test_while_nothing_can_be_written_what_is_asked_pushes_out_no_boot_that_came_again(store: Store) -> None:
    class Refusing(Inline):
        on = True

        def do(self, write: Write, done: Done, *, soon: bool = True) -> None:
            if self.on:
                done(StoreError("the disk is gone"))
            else:
                super().do(write, done, soon=soon)

    clerk, counts = Refusing(), Tally()
    kept = record.Record(store, counts, lambda: 5, clerk)
    device, key = Mock(unsaved=()), keys.parse(keys.build("w", "rpc", device=NAME, verb="note"))
    device.name, answered = NAME, list[int]()
    kept.repeat(device, 7)
    for n in range(record.REPLIES + 9):
        reply = CommandReply(f"r{n}", accepted=True, message="noted")
        kept.audit(device, key, Command(f"r{n}", "nurse", ""), reply, lambda n=n: answered.append(n))  # type: ignore[misc]
    assert answered == list(range(record.REPLIES + 9)), "nobody waits for what cannot be"
    assert counts.as_dict()[record.UNWRITTEN] == 9
    clerk.on = False
    kept._works()
    lines = store.database.rows("audit", "device = ?", (NAME,))
    assert len(lines) == record.REPLIES + 1, "and that of the boot that came again"


def test_where_another_has_the_file_that_is_told_at_once_and_nothing_is_lost(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One by one each waited for five seconds; nobody was told of the first meanwhile, and what nobody tries again was lost."""
    monkeypatch.setattr(rules, "GATHER_S", 30.0)
    monkeypatch.setattr(rules, "TOGETHER", 4)
    assert store.database._db is not None
    store.database._db.execute("PRAGMA busy_timeout = 50")
    clerk, tried, heard, told = Clerk(store.database), list[int](), list[StoreError | None](), list[StoreError | None]()
    clerk.hear(told.append)

    def write(n: int) -> None:
        tried.append(n)
        store.save_epoch(n, n)

    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        for n in range(4):
            clerk.do(partial(write, n), heard.append, soon=False)
        deadline = time.monotonic() + 20
        while len(told) < 2 and time.monotonic() < deadline:
            clerk.collect()
            time.sleep(0.01)
        assert tried[:8] == [0, 1, 2, 3] * 2, "all of them, once for each time that the file was waited for"
        assert all("locked" in str(error) for error in told)
        assert heard == []
        other.execute("COMMIT")
    clerk.close()
    assert heard == [None] * 4
    assert store.epoch() == 3


def test_at_the_end_who_has_the_file_is_waited_for_but_once(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "GATHER_S", 30.0)
    assert store.database._db is not None
    store.database._db.execute("PRAGMA busy_timeout = 50")
    clerk, heard = Clerk(store.database), list[StoreError | None]()
    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        for n in range(4):
            clerk.do(partial(store.save_epoch, n, n), heard.append, soon=False)
        clerk.close()
    assert len(heard) == 4
    assert all("locked" in str(error) for error in heard)


class Lazy(Inline):
    """Does nothing until it is told to, and then what it is told."""

    def __init__(self) -> None:
        self.given: list[tuple[Write, Done]] = []

    def do(self, write: Write, done: Done, *, soon: bool = True) -> None:
        self.given.append((write, done))

    def next(self, error: StoreError | None = None) -> None:
        write, done = self.given.pop(0)
        if error is None:
            write()
        done(error)


def test_calibrations_are_kept_in_the_order_in_which_they_were_made_though_one_fails_at_first(store: Store) -> None:
    """Which was kept last is which holds after a restart."""
    lazy = Lazy()
    kept, device = record.Record(store, Tally(), lambda: 5, lazy), Mock(unsaved=[])
    device.name = NAME
    older, newer = CALIBRATIONS[0], replace(CALIBRATIONS[0], id="newer", time_ns=9)
    kept.keep(device, older)
    kept.keep(device, newer)
    lazy.next(StoreError("locked"))  # it fails as the later one is on its way
    assert [c.id for c in device.unsaved] == ["c1", "newer"]
    lazy.next()
    assert not lazy.given
    assert device.unsaved == []
    assert (found := store.calibrated(NAME, older.boot)) is not None
    assert found.id == "newer"


def test_at_the_end_all_calibrations_that_wait_are_kept(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    clerk, device = Clerk(store.database), Mock(unsaved=[])
    device.name = NAME
    kept = record.Record(store, Tally(), lambda: 5, clerk)
    with monkeypatch.context() as full:
        full.setattr(store, "add_calibration", Mock(side_effect=StoreError("no room")))
        made = [replace(CALIBRATIONS[0], id=name) for name in ("first", "second", "third")]
        for one in made:
            kept.keep(device, one)
        deadline = time.monotonic() + 20
        while kept._saving and time.monotonic() < deadline:
            kept.collect(0.0)
            time.sleep(0.01)
    assert device.unsaved == made
    kept._save_calibrations(device)
    kept.close()
    assert device.unsaved == []
    assert [c.id for c in store.calibrations(NAME)] == ["first", "second", "third"]
