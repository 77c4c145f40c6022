from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.wire.messages import Calibration, Verdict
from estimator.service import history
from estimator.service.store import Store
from estimator.service.store_reader import REPEATED
from estimator.tracking.bias_state import BiasState
from tests.estimator.device.test_correction import CALIBRATION
from tests.estimator.stream import NAME, info

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


def same(a: Calibration | None, b: Calibration) -> bool:
    return (
        a is not None
        and (a.id, a.device, a.boot, a.verdict, a.parameters) == (b.id, b.device, b.boot, b.verdict, b.parameters)
        and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("matrix", "bias", "covariance"))
    )


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


@pytest.mark.parametrize("by", ["", GOOD.id])
def test_a_doubt_of_before_a_calibration_tells_nothing_of_it(by: str, store: Store) -> None:
    store.add_calibration(GOOD)
    store.save_bias(NAME, 1, 5, BIAS, history=False, doubted=True, calibration=by)
    remembered = store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.doubted == bool(by)
    assert (remembered.bias is None) == (not by), "what was doubted is not gone on with"


@pytest.mark.parametrize("later_ns", [-AHEAD_NS, 5], ids=["clock set back", "later"])
def test_nothing_of_before_is_of_a_boot_whose_number_came_again(store: Store, later_ns: int) -> None:
    """Whatever clocks say; what was not kept yet is named."""
    unsaved, new = replace(GOOD, id="unsaved"), replace(GOOD, id="new", time_ns=max(0, GOOD.time_ns + later_ns))
    store.add_calibration(GOOD)
    with store.database.transaction():
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


def test_calibrations_are_only_appended_and_the_latest_bias_is_one(store: Store) -> None:
    with pytest.raises(ValueError, match="REPEAT"):
        store.add_calibration(replace(GOOD, verdict=Verdict.REPEAT))
    boot = 2**64 - 1
    good = replace(GOOD, boot=boot)
    store.add_calibration(good)
    store.add_calibration(replace(good, matrix=np.eye(3)))  # the same id, other numbers
    store.add_calibration(replace(good, id="c2", time_ns=2))
    assert [c.id for c in store.calibrations(NAME)] == ["c1", "c2"]
    assert same(store.calibrations(NAME)[0], good)
    for second in range(5):
        store.save_bias(
            NAME, boot, second, replace(BIAS, time=float(second)), history=second % 2 == 0, calibration="c2"
        )
    assert len(store.database.rows("bias_history")) == 3
    assert len(store.database.rows("bias")) == 1
    remembered = store.recall(NAME, boot, 0)
    assert remembered is not None
    assert remembered.calibration is not None
    assert (remembered.calibration.id, remembered.calibration.boot) == ("c2", boot)
    assert remembered.bias is not None
    assert remembered.bias.time == 4.0
