"""A bias history that is kept for years does not grow without end, and teaches what it taught."""

import time
from pathlib import Path

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire import keys
from estimator import history
from estimator.database import Change
from estimator.service.record import BOOTS_LOOKED_AFTER, THIN_S
from estimator.service.retention import ALL_DAYS, DAY_NS, END_NS, HOUR_NS, RECENT_BOOTS, YEAR_NS, old_boots, superfluous
from estimator.service.store import BOOTS, POINTS, STRETCH, Store, _point
from estimator.session import DeviceSession
from estimator.track.bias_filter import BiasState
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, calibration, feed, info, stream

MINUTE_NS, HALF_NS = 60 * 10**9, HOUR_NS // 2
NOW_NS = 1_700_000_000 * 10**9


def test_years_of_points_come_to_a_few_thousand() -> None:
    """A point each half hour, thinned every thirty days."""
    kept: list[int] = []
    counts = []
    for day in range(6 * 365):
        now_ns = NOW_NS + day * DAY_NS
        kept += [now_ns - DAY_NS + i * HALF_NS for i in range(48)]
        if day % 30 == 0:
            gone = set(superfluous(kept, now_ns))
            kept = [time for i, time in enumerate(kept) if i not in gone]
            counts.append(len(kept))
    most = 48 * (ALL_DAYS + 31) + 24 * 120 + 5 * 366
    assert max(counts) < most
    assert counts[-1] == pytest.approx(counts[-6], rel=0.05), "it has come to an end"
    age = now_ns - np.array(kept)
    assert age.max() <= END_NS + 30 * DAY_NS
    assert np.diff(kept)[age[1:] < ALL_DAYS * DAY_NS].max() == HALF_NS
    assert np.diff(kept)[age[1:] < 89 * DAY_NS].max() <= HOUR_NS
    assert np.diff(kept).max() <= 2 * DAY_NS


def test_what_is_spared_or_of_one_moment_stays() -> None:
    old = [NOW_NS - 30 * DAY_NS + i for i in range(10)]
    assert superfluous(old, NOW_NS) == list(range(9))
    assert superfluous(old, NOW_NS, spared=4) == [4, 5, 6, 7, 8]
    assert superfluous([old[0]] * 3, NOW_NS) == []


def fill(store: Store, boots: int, points: int, end_ns: int) -> None:
    """So many boots, one after the other, a point a minute; the last ends at end_ns."""
    state = BiasState(np.zeros(6), 1e-8 * np.eye(6), 1.0, 30.0)
    for n in range(boots):
        boot, begin_ns = n + 1, end_ns - (boots - n) * points * MINUTE_NS
        store.add_boot(info(boot), begin_ns)
        rows = [_point(NAME, boot, begin_ns + i * MINUTE_NS, state) | {"x": float(i)} for i in range(points)]
        store.database.write(*(Change("bias_history", row) for row in rows))
        store.save_bias(NAME, boot, begin_ns, state, history=False)


def thin(store: Store, now_ns: int) -> None:
    for boot in store.boots_kept(NAME):
        after_ns: int | None = 0
        while after_ns is not None:
            after_ns = store.thin(NAME, boot, after_ns, now_ns)


def test_what_a_law_is_learnt_from_is_not_thinned_and_each_boots_end_stays() -> None:
    store = Store(":memory:")
    boots, points = BOOTS + 4, POINTS + 400
    fill(store, boots, points, NOW_NS)
    newest = info(boots + 1)
    taught, before = store.points(newest), history.read(store, NAME)
    thin(store, NOW_NS + 30 * DAY_NS)
    for was, is_ in zip(taught, store.points(newest), strict=True):
        np.testing.assert_array_equal(was.time, is_.time)
        np.testing.assert_array_equal(was.bias, is_.bias)
    after = history.read(store, NAME)
    assert [b.bias[-1, 0] for b in after.biases] == [b.bias[-1, 0] for b in before.biases]
    lengths = {of.boot: len(of.time_ns) for of in after.biases}
    assert lengths[keys.boot_id(1)] < 20, "a boot nothing is learnt from any more: one an hour"
    assert POINTS < lengths[keys.boot_id(boots)] < POINTS + 20
    thin(store, NOW_NS + 30 * DAY_NS)
    again = {of.boot: len(of.time_ns) for of in history.read(store, NAME).biases}
    assert all(lengths[boot] - 2 <= n <= lengths[boot] for boot, n in again.items()), "the seams of its stretches"
    store.close()


def test_a_damaged_point_keeps_none_behind_it_from_being_thinned() -> None:
    store = Store(":memory:")
    fill(store, BOOTS + 2, 3 * STRETCH, NOW_NS)  # nothing is learnt from the first any more
    damaged = "UPDATE bias_history SET digest = x'00' WHERE rowid = 7"
    store.database._do(lambda db: db.execute(damaged), "")
    thin(store, NOW_NS + 30 * DAY_NS)
    whole = {of.boot: len(of.time_ns) for of in history.read(store, NAME).biases}
    assert whole[keys.boot_id(1)] < 40
    assert store.database.damaged
    store.close()


def test_the_service_thins_in_small_pieces_once_a_day(tmp_path: Path) -> None:
    ward = Ward(tmp_path)
    ward.send(stream([], 2.0).batches(boot=99), info(99))
    fill(ward.store, 2 * BOOTS, POINTS, NOW_NS - 60 * DAY_NS)
    record, device = ward.service._record, ward.service._devices[NAME]
    before = len(ward.store.database.rows("bias_history"))
    record.thin(device, 0.0)
    first = len(ward.store.database.rows("bias_history"))
    assert before - STRETCH <= first < before
    while device.to_thin:
        record.thin(device, 0.0)
    thinned = len(ward.store.database.rows("bias_history"))
    assert thinned < first - 5 * 0.9 * POINTS
    fill(ward.store, 1, 10, NOW_NS - 40 * DAY_NS)
    record.thin(device, THIN_S - 1.0)
    assert not device.to_thin
    record.thin(device, THIN_S)
    assert device.to_thin
    ward.kill()


def test_what_is_new_stays_as_it_is() -> None:
    store = Store(":memory:")
    fill(store, 2, 600, NOW_NS)
    thin(store, NOW_NS + 6 * DAY_NS)
    assert [len(of.time_ns) for of in history.read(store, NAME).biases] == [600, 600]
    store.close()


def test_years_of_boots_come_to_a_few_thousand() -> None:
    """A boot every twenty minutes, looked after every 32 boots."""
    kept: list[int] = []
    counts = []
    for boot in range(6 * 365 * 72):
        now_ns = NOW_NS + boot * 20 * MINUTE_NS
        kept.append(now_ns)
        if boot % 3200 == 0:
            gone = set(old_boots(kept, now_ns))
            kept = [time for i, time in enumerate(kept) if i not in gone]
            counts.append(len(kept))
    assert max(counts) < RECENT_BOOTS + 24 * 90 + 5 * 366 + 24
    assert counts[-1] == pytest.approx(counts[-6], rel=0.05), "it has come to an end"
    assert kept[-RECENT_BOOTS:] == [now_ns - n * 20 * MINUTE_NS for n in reversed(range(RECENT_BOOTS))]
    assert now_ns - kept[0] <= END_NS + 45 * DAY_NS


def test_a_device_that_starts_anew_every_minute_fills_no_store(tmp_path: Path) -> None:
    ward = Ward(tmp_path)
    store, boots = ward.store, 1200
    state = BiasState(np.zeros(6), 1e-8 * np.eye(6), 1.0, 30.0)
    of_boot_7 = DeviceSession(NAME)
    feed(of_boot_7, calibration(seed=1).batches(boot=7))
    assert of_boot_7.calibration is not None
    store.add_calibration(of_boot_7.calibration)
    now_ns = [0]
    ward.service._record._now_ns = lambda: now_ns[0]
    for boot in range(1, boots + 1):
        now_ns[0] = NOW_NS + boot * MINUTE_NS
        ward.service._record.boot(of_boot_7, info(boot, firmware="old" if boot < 20 else "1.0"))
        store.save_bias(NAME, boot, now_ns[0], state, history=True)
    for table in ("boots", "bias", "bias_history"):
        names = {row["boot"] for row in store.database.rows(table)}
        assert len(names) < RECENT_BOOTS + 2 * BOOTS_LOOKED_AFTER + boots // 60 + 1 + BOOTS + 1, table
        assert {keys.boot_id(boot) for boot in range(boots - RECENT_BOOTS + 1, boots + 1)} <= names
        assert keys.boot_id(7) in names, "it was calibrated"
        assert {keys.boot_id(boot) for boot in range(20 - BOOTS - 1, 20)} <= names, "a law may be learnt from them"
    assert store.calibrations(NAME)[0].boot == 7
    assert store.recall(NAME, 7, now_ns[0]) is not None
    assert store.thin_boots("another", now_ns[0]) == 0
    ward.kill()


def test_boots_of_an_upgraded_store_are_forgotten_piece_by_piece() -> None:
    store = Store(":memory:")
    for boot in range(1, 2 * STRETCH + RECENT_BOOTS):
        store.add_boot(info(boot), NOW_NS + boot * 10**9)
    assert store.thin_boots(NAME, NOW_NS + DAY_NS) == STRETCH
    assert 0 < store.thin_boots(NAME, NOW_NS + DAY_NS) < STRETCH
    assert store.thin_boots(NAME, NOW_NS + DAY_NS) == 0
    assert RECENT_BOOTS <= len(store.database.rows("boots")) <= RECENT_BOOTS + 2
    store.close()


def test_a_clock_that_is_wrong_thins_nothing() -> None:
    store = Store(":memory:")
    fill(store, BOOTS + 4, 2 * POINTS, NOW_NS)
    for boot in range(100, 100 + 2 * RECENT_BOOTS):
        store.add_boot(info(boot), NOW_NS + boot * DAY_NS)
    before = [len(of.time_ns) for of in history.read(store, NAME).biases]
    ahead_ns = NOW_NS + 73 * YEAR_NS
    store.add_boot(info(999), ahead_ns)
    store.save_bias(NAME, 999, ahead_ns, BiasState(np.zeros(6), 1e-8 * np.eye(6), 1.0, 30.0), history=True)
    thin(store, ahead_ns + DAY_NS // 2)
    assert [len(of.time_ns) for of in history.read(store, NAME).biases][:-1] == before
    assert store.thin_boots(NAME, ahead_ns + DAY_NS // 2) == 0
    store.close()


def test_boots_of_a_time_to_come_stand_in_nobodys_way() -> None:
    """A clock was wrong for a while: those after it are learnt from, and are the ones that stay."""
    store, hour_ns = Store(":memory:"), HOUR_NS // 60
    fill(store, 2, POINTS, NOW_NS)
    for boot in range(1000, 1000 + RECENT_BOOTS):
        store.add_boot(info(boot), NOW_NS + 73 * YEAR_NS + boot * hour_ns)
    for boot in range(2000, 2000 + RECENT_BOOTS):
        store.add_boot(info(boot), NOW_NS + boot * hour_ns)
    now_ns = NOW_NS + 3000 * hour_ns
    store.thin_boots(NAME, now_ns)
    kept = set(store.boots(NAME, 999))
    assert set(range(2000, 2000 + RECENT_BOOTS)) <= kept
    state = BiasState(np.zeros(6), 1e-8 * np.eye(6), 1.0, 30.0)
    store.save_bias(NAME, 2000 + RECENT_BOOTS - 1, now_ns, state, history=True)
    assert [len(points.time) for points in store.points(info(9999))] == [1]
    store.close()


def test_a_silent_device_adds_nothing_to_its_history(tmp_path: Path) -> None:
    """A law was taught the same point sixty times an hour, and a picture showed a bias that nobody had seen."""
    ward, of = Ward(tmp_path), calibration(seed=1, after=[Still(4.0)]).batches()
    ward.send(of[:-20], info(1))
    record, device = ward.service._record, ward.service._devices[NAME]

    def points() -> int:
        return len(ward.store.database.rows("bias_history"))

    (made,) = ward.store.calibrations(NAME)
    assert [row["time_ns"] for row in ward.store.database.rows("bias_history")] == [ward.now_ns]
    assert made.id == device.session.calibration.id  # type: ignore[union-attr]
    now = time.monotonic()
    for minute in (2, 3, 4):
        ward.now_ns += 60 * 10**9
        record.checkpoint(device, now + 60 * minute)
    assert points() == 2, "what came after the calibration is news, once"
    ward.send(of[-20:])
    device.heard = now + 300
    record.checkpoint(device, now + 301)
    assert points() == 3
    ward.kill()
