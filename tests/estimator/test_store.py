import sqlite3
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.wire.messages import Calibration, Verdict
from estimator import history
from estimator.database import APPLICATION_ID, SCHEMA_VERSION
from estimator.database.database import RETRY_S
from estimator.service import store as service_store
from estimator.service.store import REPEATED, Store, StoreError
from estimator.track.bias_filter import BiasState
from tests.estimator.stream import NAME, info
from tests.estimator.test_correction import CALIBRATION

BIAS = BiasState(
    np.array([0.1, -0.2, 0.3, 0.0, 0.0, 0.0]),
    np.diag([1e-8, 2e-8, 3e-8, 1e-12, 1e-12, 1e-12]),
    123.456,
    31.5,
    powered=30.0,
    lag_k=0.5,
)
GOOD = replace(CALIBRATION, model="m", firmware="1.0", gyro_range=8.7, rate_hz=104.0)

AHEAD_NS = 4_070_908_800 * 10**9  # 2099


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    opened = Store(tmp_path / "a.sqlite3")
    yield opened
    opened.close()


def sql(store: Store, statement: str) -> list[tuple[object, ...]]:
    other = sqlite3.connect(store.path)
    try:
        with other:
            return other.execute(statement).fetchall()
    finally:
        other.close()


def same(a: Calibration | None, b: Calibration) -> bool:
    return (
        a is not None
        and (a.id, a.device, a.boot, a.verdict, a.parameters) == (b.id, b.device, b.boot, b.verdict, b.parameters)
        and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("matrix", "bias", "covariance"))
    )


def test_the_highest_epoch_is_kept_and_no_device_is_made_of_it(store: Store) -> None:
    assert store.epoch() == 0
    for epoch, time_ns in ((7, AHEAD_NS), (2**50, 5)):
        store.save_epoch(epoch, time_ns)
        assert store.epoch() == epoch
    assert store.reached(0) == {}
    assert history.devices(store) == []


def test_what_was_written_is_there_after_a_restart(tmp_path: Path) -> None:
    first = Store(tmp_path / "a.sqlite3")
    first.add_calibration(GOOD)
    first.save_bias(NAME, 1, 5, BIAS, history=True)
    first.close()
    again = Store(tmp_path / "a.sqlite3")
    remembered = again.recall(NAME, 1, 0)
    again.close()
    assert remembered is not None
    assert same(remembered.calibration, GOOD)
    assert remembered.bias is not None
    np.testing.assert_array_equal(remembered.bias.x, BIAS.x)
    np.testing.assert_array_equal(remembered.bias.P, BIAS.P)
    got = remembered.bias
    assert (got.time, got.temperature_c, got.powered, got.lag_k) == (123.456, 31.5, 30.0, 0.5)


def test_an_unknown_temperature_and_power_up_stay_unknown(store: Store) -> None:
    store.add_calibration(GOOD)
    store.save_bias(NAME, 1, 5, BiasState(BIAS.x, BIAS.P, 1.0), history=True)
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.bias is not None
    assert np.isnan(remembered.bias.temperature_c)
    assert remembered.bias.powered == -np.inf


@pytest.mark.parametrize("by", ["", GOOD.id])
def test_a_doubt_of_before_a_calibration_tells_nothing_of_it(by: str, store: Store) -> None:
    store.add_calibration(GOOD)
    store.save_bias(NAME, 1, 5, BIAS, history=False, doubted=True, calibration=by)
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.doubted == bool(by)
    assert (remembered.bias is None) == (not by), "what was doubted is not gone on with"


def test_nothing_is_remembered_of_another_boot_or_device(store: Store) -> None:
    store.add_calibration(GOOD)
    assert store.recall(NAME, 2, 0) is None
    assert store.recall("other", 1, 0) is None


@pytest.mark.parametrize("later_ns", [-AHEAD_NS, 5], ids=["clock set back", "later"])
def test_nothing_of_before_is_of_a_boot_whose_number_came_again(store: Store, later_ns: int) -> None:
    """Whatever clocks say; what was not kept yet is named."""
    unsaved, new = replace(GOOD, id="unsaved"), replace(GOOD, id="new", time_ns=max(0, GOOD.time_ns + later_ns))
    store.add_calibration(GOOD)
    with store.database.together():
        store.save_bias(NAME, 1, 5, BIAS, history=False, reached=(1000, 5))
        store.repeat(NAME, 1, 6, [unsaved.id])
    store.add_calibration(unsaved)
    assert store.recall(NAME, 1, 0) is None
    assert store.reached(0) == {}
    assert [row["verb"] for row in history.read(store, NAME).commands] == [REPEATED]
    store.add_calibration(new)
    assert same(store.calibrated(NAME, 1), new)
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.bias is None


@pytest.mark.parametrize("verdict", [Verdict.REPEAT, Verdict.REFUSED, Verdict.UNKNOWN])
def test_only_an_accepted_calibration_is_kept(store: Store, verdict: Verdict) -> None:
    with pytest.raises(ValueError, match=verdict.name):
        store.add_calibration(replace(GOOD, verdict=verdict))
    assert store.calibrations(NAME) == []


def test_it_is_append_only(store: Store) -> None:
    store.add_calibration(GOOD)
    store.add_calibration(replace(GOOD, matrix=np.eye(3)))  # the same id, other numbers
    store.add_calibration(replace(GOOD, id="c2", time_ns=2))
    found = store.calibrations(NAME)
    assert [c.id for c in found] == ["c1", "c2"]
    assert same(found[0], GOOD)
    latest = store.recall(NAME, 1, 0)
    assert latest is not None
    assert latest.calibration is not None
    assert latest.calibration.id == "c2"


def test_bias_history_grows_and_the_latest_bias_is_one(store: Store) -> None:
    store.add_calibration(GOOD)
    for second in range(5):
        store.save_bias(NAME, 1, second, replace(BIAS, time=float(second)), history=second % 2 == 0)
    assert sql(store, "SELECT count(*) FROM bias_history") == [(3,)]
    assert sql(store, "SELECT count(*) FROM bias") == [(1,)]
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.bias is not None
    assert remembered.bias.time == 4.0


@pytest.mark.parametrize("change", ["model", "firmware", "gyro_range", "rate_hz"])
def test_a_prior_needs_the_whole_restore_key(store: Store, change: str) -> None:
    store.add_calibration(GOOD)
    this = replace(info(boot=2), has_clock=False)
    assert same(store.prior(this), GOOD)
    other = {"model": "n", "firmware": "1.1", "gyro_range": 4.3, "rate_hz": 208.0}[change]
    assert store.prior(replace(this, **{change: other})) is None  # type: ignore[arg-type]
    assert store.prior(replace(this, device="other")) is None
    assert store.prior(replace(this, boot=1)) is None, "this boot's own calibration is no prior"


def test_a_device_with_a_clock_may_have_been_calibrated_at_another_rate(store: Store) -> None:
    store.add_calibration(GOOD)
    assert same(store.prior(replace(info(boot=2), rate_hz=26.0)), GOOD)


def test_a_device_without_a_clock_is_found_again_by_a_rate_that_is_estimated_anew(store: Store) -> None:
    store.add_calibration(GOOD)
    store.add_boot(replace(info(1), has_clock=False), 5)
    store.save_bias(NAME, 1, 6, BIAS, history=True)
    this = replace(info(boot=2), has_clock=False, rate_hz=GOOD.rate_hz * 1.007)
    assert same(store.prior(this), GOOD)
    assert len(store.points(this)) == 1
    assert store.prior(replace(this, rate_hz=GOOD.rate_hz * 1.03)) is None


def test_the_prior_is_the_latest(store: Store) -> None:
    for n in (1, 2, 3):
        store.add_calibration(replace(GOOD, id=f"c{n}", boot=n, time_ns=n))
    prior = store.prior(info(boot=9))
    assert prior is not None
    assert prior.id == "c3"


def test_of_earlier_boots_of_the_same_hardware_the_last_calibrations_come_in_their_order(store: Store) -> None:
    for n, boot in enumerate((1, 2, 2, 3, 4)):
        other = {"firmware": "1.1"} if boot == 3 else {}
        store.add_calibration(replace(GOOD, id=f"c{n}", boot=boot, time_ns=100 - n, **other))  # type: ignore[arg-type]
    assert [c.id for c in store.earlier(info(boot=4))] == ["c0", "c2"]
    assert [c.id for c in store.earlier(info(boot=5))] == ["c0", "c2", "c4"]
    assert store.earlier(replace(info(boot=5), device="other")) == []


def test_what_was_calibrated_while_the_clock_was_behind_is_not_undone_when_it_is_right_again(store: Store) -> None:
    for name, time_ns in (("before", 50), ("again", 40)):
        store.add_calibration(replace(GOOD, id=name, time_ns=time_ns))
    for now_ns in (45, 100):
        remembered = store.recall(NAME, 1, now_ns)
        assert remembered is not None
        assert remembered.calibration is not None
        assert remembered.calibration.id == "again"
    assert same(store.prior(info(boot=9)), replace(GOOD, id="again"))


def test_a_time_that_lies_ahead_is_no_reason_to_prefer_a_calibration(store: Store) -> None:
    for n, time_ns in enumerate((5, AHEAD_NS, 20, 30), 1):
        store.add_calibration(replace(GOOD, id=f"c{n}", boot=n, time_ns=time_ns))
    assert same(store.prior(info(boot=9)), replace(GOOD, id="c4", boot=4))
    assert same(store.latest(NAME), replace(GOOD, id="c4", boot=4))
    store.add_calibration(replace(GOOD, id="c5", boot=2, time_ns=40))
    remembered = store.recall(NAME, 2, 100)
    assert remembered is not None
    assert same(remembered.calibration, replace(GOOD, id="c5", boot=2))
    store.add_calibration(replace(GOOD, id="c6", boot=2, time_ns=AHEAD_NS))
    remembered = store.recall(NAME, 2, 100)
    assert remembered is not None
    assert same(remembered.calibration, replace(GOOD, id="c6", boot=2)), "it was written last"


@pytest.mark.parametrize(
    "damage",
    ["payload = x'0102'", "payload = CAST(payload || x'00' AS BLOB)", "digest = x'00'", "boot = '0000000000000002'"],
)
def test_a_damaged_calibration_is_refused_and_the_one_before_is_used(
    store: Store, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    store.add_calibration(GOOD)
    store.add_calibration(replace(GOOD, id="c2", time_ns=2))
    sql(store, f"UPDATE calibrations SET {damage} WHERE id = 'c2'")
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.calibration is not None
    assert remembered.calibration.id == "c1"
    assert "row 2 of calibrations is damaged" in caplog.text
    assert [c.id for c in store.calibrations(NAME)] == ["c1"]


def test_a_payload_of_another_device_is_refused(store: Store, caplog: pytest.LogCaptureFixture) -> None:
    store.add_calibration(GOOD)
    sql(store, "UPDATE calibrations SET device = 'other'")
    assert store.recall("other", 1, 0) is None
    assert "damaged" in caplog.text


def test_one_of_long_ago_is_found_behind_many(store: Store) -> None:
    made = [
        replace(GOOD, id=f"c{n}", boot=100 + n, time_ns=1000 + n, firmware="1.0" if n == 3 else "2.0")
        for n in range(40)
    ]
    for c in made:
        store.add_calibration(c)
    remembered = store.recall(NAME, 107, 0)
    assert remembered is not None
    assert same(remembered.calibration, made[7])
    assert same(store.prior(replace(info(500), firmware="1.0")), made[3])
    assert same(store.latest(NAME), made[39])
    assert store.recall(NAME, 500, 0) is None


@pytest.mark.parametrize("damage", ["state = replace(state, '0.1', '0.9')", "digest = x''"])
def test_a_damaged_bias_is_not_used(store: Store, damage: str, caplog: pytest.LogCaptureFixture) -> None:
    store.add_calibration(GOOD)
    store.save_bias(NAME, 1, 5, BIAS, history=False)
    sql(store, f"UPDATE bias SET {damage}")
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.bias is None
    assert "damaged" in caplog.text


def test_a_file_that_goes_bad_under_it_is_a_store_error_and_then_put_right(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store, clock = Store(tmp_path / "a.sqlite3"), [0.0]
    store.database._clock = lambda: clock[0]
    store.add_calibration(GOOD)
    store.add_boot(info(1), 5)
    sql(store, "DROP TABLE boots")
    with pytest.raises(StoreError, match="backup"):
        store.points(info(boot=2))
    with pytest.raises(StoreError, match="boots"):
        store.add_boot(info(boot=2), 5)
    clock[0] += RETRY_S
    store.add_boot(info(boot=2), 5)
    assert "was damaged" in caplog.text
    assert "boots cannot be read" in caplog.text
    assert [c.id for c in store.calibrations(NAME)] == ["c1"]
    store.close()


def test_a_schema_of_the_future_is_refused(store: Store) -> None:
    sql(store, f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    with pytest.raises(StoreError, match="update truerate"):
        Store(store.path)


def test_what_is_no_store_is_refused_with_advice(tmp_path: Path) -> None:
    text = tmp_path / "text"
    text.write_text("this is no database, whatever its length may be " * 100)
    for path, words in (
        (text / "a.sqlite3", "check that the folder exists"),
        (tmp_path, "check that the folder exists"),
        (text, "not an SQLite file"),
    ):
        with pytest.raises(StoreError, match=words) as refused:
            Store(path)
        assert str(path) in str(refused.value)


@pytest.mark.parametrize("mark", ["CREATE TABLE calibrations (a)", "PRAGMA application_id = 7"])
def test_another_programs_file_is_refused_and_left_as_it_is(tmp_path: Path, mark: str) -> None:
    path = tmp_path / "foreign"
    foreign = sqlite3.connect(path)
    foreign.execute(mark)
    foreign.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match="another program"):
        Store(path)
    assert path.read_bytes() == before


def test_a_store_is_marked_as_ours_and_read_only_when_whole(store: Store) -> None:
    assert sql(store, "PRAGMA application_id") == [(APPLICATION_ID,)]
    Store(store.path).close()
    sql(store, "DROP TABLE boots")
    with pytest.raises(StoreError, match="its tables are not those"):
        Store.reading(store.path)


def test_its_folder_is_made(tmp_path: Path) -> None:
    path = tmp_path / "out" / "deep" / "a.sqlite3"
    Store(path).close()
    assert path.exists()


def test_what_a_command_was_answered_is_found_again(store: Store) -> None:
    assert store.answer(NAME, "recalibrate", "r1") is None
    store.add_audit(5, NAME, "recalibrate", "r1", "nurse", "strap", "done", accepted=True)
    store.add_audit(6, NAME, "cancel", "r2", "nurse", "", "nothing to cancel", accepted=False)
    assert store.answer(NAME, "recalibrate", "r1") == (True, "done")
    assert store.answer(NAME, "cancel", "r2") == (False, "nothing to cancel")
    assert store.answer(NAME, "cancel", "r1") is store.answer("other", "recalibrate", "r1") is None


def test_an_audit_keeps_the_latest_of_each_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_store, "AUDITED", 50)
    monkeypatch.setattr(service_store, "_LOOKED_AFTER", 10)
    for run in range(2):  # restarts do not matter
        store = Store(tmp_path / "a.sqlite3")
        store.add_audit(run, "other", "note", f"other-{run}", "nurse", "", "noted", accepted=True)
        for n in range(100 * run, 100 * run + 100):
            store.add_audit(n, NAME, "note", f"r{n}", "nurse", "", "noted", accepted=True)
        kept = [row["time_ns"] for row in store.database.rows("audit", "device = ?", (NAME,))]
        assert 50 <= len(kept) < 60
        assert kept == list(range(100 * run + 100 - len(kept), 100 * run + 100))
        assert store.answer("other", "note", "other-0") is not None
        store.close()


def test_its_settings_survive_a_kill(store: Store) -> None:
    db = store.database._db
    assert db is not None
    assert db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert db.execute("PRAGMA synchronous").fetchone() == (2,)
    store.add_calibration(GOOD)
    # Another process sees it although this one has not closed.
    assert sql(store, "SELECT id FROM calibrations") == [("c1",)]


def test_boots_and_audit(store: Store) -> None:
    store.add_boot(info(1), 10)
    store.add_boot(info(1), 20)
    store.add_boot(info(2), 30)
    assert sql(store, "SELECT boot, time_ns, cause FROM boots") == [
        ("0000000000000001", 10, "POWER_UP"),
        ("0000000000000002", 30, "POWER_UP"),
    ]
    store.add_audit(5, NAME, "recalibrate", "r1", "nurse", "strap", "done", accepted=True)
    columns = "time_ns, device, verb, request_id, who, reason, accepted, message"
    assert sql(store, f"SELECT {columns} FROM audit") == [(5, NAME, "recalibrate", "r1", "nurse", "strap", 1, "done")]


def test_a_boot_number_of_64_bits_is_kept(store: Store) -> None:
    boot = 2**64 - 1
    store.add_calibration(replace(GOOD, boot=boot))
    store.save_bias(NAME, boot, 5, BIAS, history=False)
    remembered = store.recall(NAME, boot, 0)
    assert remembered is not None
    assert remembered.calibration is not None
    assert remembered.calibration.boot == boot
    assert remembered.bias is not None


@pytest.mark.parametrize("together", [True, False])
def test_what_a_device_is_may_be_known_only_later_in_its_boot(store: Store, *, together: bool) -> None:
    """Else what it taught of temperature is looked for in vain, by who knows its firmware from the first."""
    first, wider = replace(info(7), firmware="", model=""), replace(info(7), gyro_range=99.0)
    with store.database.together() if together else nullcontext():
        store.add_boot(first, 5)
        store.add_boot(info(7), 9)
        store.add_boot(first, 11)  # as a bridge that was restarted says it
        store.add_boot(wider, 12)  # what it taught was taught in the range that it had
    (row,) = store.database.rows("boots")
    assert (row["firmware"], row["model"], row["gyro_range"], row["time_ns"]) == (
        "1.0",
        info(7).model,
        info(7).gyro_range,
        5,
    )
    store.save_bias(NAME, 7, 20, BIAS, history=True)
    assert len(store.points(info(8))) == 1
    again = Store(store.path)
    again.add_boot(first, 13)
    again.add_boot(info(9), 14)
    assert again.boots(NAME, 9) == store.boots(NAME, 9) == [7, 9]
    assert again.database.rows("boots")[0] == row
    again.close()
