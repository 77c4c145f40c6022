"""A store that is kept for years does not grow without end, and teaches what it taught."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.wire import keys
from estimator.service import history
from estimator.service.retention import ALL_NS, BOOTS, DAY_NS, HOUR_NS, HOURLY_NS, KEPT_BOOTS, POINTS
from estimator.service.store import Store
from estimator.service.store_care import THIN_S
from estimator.tracking.bias_state import BiasState
from tests.estimator.device.test_correction import CALIBRATION
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, info

MINUTE_NS = 60 * 10**9
NOW_NS = 1_700_000_000 * 10**9
STATE = BiasState(np.zeros(6), 1e-8 * np.eye(6), 1.0, 30.0)


@pytest.fixture
def store() -> Store:
    return Store(":memory:")


def fill(store: Store, boots: int, points: int, end_ns: int, step_ns: int = MINUTE_NS) -> None:
    """So many boots, one after the other, with so many points each; the last ends at end_ns."""
    with store.database.transaction():
        for boot in range(1, boots + 1):
            begin_ns = end_ns - (boots - boot + 1) * points * step_ns
            store.add_boot(info(boot), begin_ns)
            for i in range(points):
                state = replace(STATE, x=np.array([float(i), 0.0, 0.0, 0.0, 0.0, 0.0]))
                store.save_bias(NAME, boot, begin_ns + i * step_ns, state, history=True)


def test_old_points_are_kept_by_the_hour_and_older_ones_by_the_day(store: Store) -> None:
    fill(store, 1, 200 * 48, NOW_NS, HOUR_NS // 2)
    deleted = store.thin(NAME, NOW_NS)
    (of,) = history.read(store, NAME).biases
    assert deleted == {"bias_history": 200 * 48 - len(of.time_ns)}
    age_ns, step_ns = NOW_NS - of.time_ns[POINTS + 2 :], np.diff(of.time_ns[POINTS + 1 :])
    assert set(step_ns[age_ns < ALL_NS]) == {HOUR_NS // 2}
    assert set(step_ns[(age_ns > ALL_NS + HOUR_NS) & (age_ns < HOURLY_NS - DAY_NS)]) == {HOUR_NS}
    assert set(step_ns[age_ns > HOURLY_NS + DAY_NS]) == {DAY_NS}
    store.thin(NAME, NOW_NS)
    assert len(history.read(store, NAME).biases[0].time_ns) == len(of.time_ns)


def test_what_a_law_is_learnt_from_is_not_thinned_and_each_boots_end_stays(store: Store) -> None:
    boots = BOOTS + 4
    fill(store, boots, POINTS + 200, NOW_NS)
    newest = info(boots + 1)
    taught, before = store.points(newest), history.read(store, NAME)
    store.thin(NAME, NOW_NS + 30 * DAY_NS)
    for was, is_ in zip(taught, store.points(newest), strict=True):
        np.testing.assert_array_equal(was.time, is_.time)
        np.testing.assert_array_equal(was.bias, is_.bias)
    after = history.read(store, NAME)
    assert [b.bias[-1, 0] for b in after.biases] == [b.bias[-1, 0] for b in before.biases]
    lengths = {of.boot: len(of.time_ns) for of in after.biases}
    assert lengths[keys.boot_id(1)] < 20, "a boot nothing is learnt from any more: one an hour"
    assert POINTS < lengths[keys.boot_id(boots)] < POINTS + 10


def test_a_device_that_starts_anew_every_minute_fills_no_store(store: Store) -> None:
    more = 200
    store.add_calibration(replace(CALIBRATION, boot=7))
    with store.database.transaction():
        for boot in range(1, KEPT_BOOTS + more + 1):
            time_ns = NOW_NS + boot * MINUTE_NS
            store.add_boot(info(boot, firmware="old" if boot < 20 else "1.0"), time_ns)
            store.save_bias(NAME, boot, time_ns, STATE, history=True)
    store.save_bias(NAME, 10**6, NOW_NS + 20 * DAY_NS, STATE, history=True)  # nothing is known of its device yet
    store.thin(NAME, NOW_NS + 20 * DAY_NS)
    calibrated, teaching = {7}, {*range(20 - BOOTS - 1, 20)}
    kept = calibrated | teaching | {*range(more + 1, KEPT_BOOTS + more + 1)}
    assert set(store.boots(NAME, 10**6)) == kept
    for table in ("bias", "bias_history"):
        assert {int(row["boot"], 16) for row in store.database.rows(table)} == kept | {10**6}
    assert store.recall(NAME, 7, NOW_NS) is not None


def test_the_service_thins_and_backs_up_once_a_day(tmp_path: Path) -> None:
    ward = Ward(tmp_path)
    fill(ward.store, 2 * BOOTS, POINTS + 60, ward.now_ns - 60 * DAY_NS)
    care, before = ward.service._care, len(ward.store.database.rows("bias_history"))
    care.tend(0.0, 1)
    thinned = len(ward.store.database.rows("bias_history"))
    assert thinned < before - BOOTS * POINTS / 2
    assert [one.name for one in (tmp_path / "backups").iterdir()] == ["store-00001.sqlite3"]
    fill(ward.store, BOOTS - 2, 300, ward.now_ns - 30 * DAY_NS)
    more = len(ward.store.database.rows("bias_history"))
    care.tend(THIN_S - 1.0, 1)
    assert len(ward.store.database.rows("bias_history")) == more
    care.tend(THIN_S, 1)
    assert len(ward.store.database.rows("bias_history")) < more
    ward.kill()
