"""What temperature does is learnt in one boot, kept, and used in the next: sessions and store as the service has them."""

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.sim.motion import Still
from bridge.wire.messages import SampleBatch
from bridge.wire.refusal import Tally
from estimator.database import Database
from estimator.remembered import Remembered
from estimator.service.clerk import Clerk
from estimator.service.device import Device
from estimator.service.record import Record
from estimator.service.store import BOOTS, POINTS, Store
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
from estimator.track.bias_filter import BIAS, SLOPE, BiasKnobs, BiasState
from estimator.track.learning import Points, learn
from estimator.track.temperature import Floats, TemperatureLaw
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, calibration, feed, info
from tests.estimator.track.test_temperature import KNOBS, LAW, boot, learnt
from tests.sim.day import simulate_day

HOUR_NS = 3_600_000_000_000


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    opened = Store(tmp_path / "a.sqlite3")
    yield opened
    opened.close()


def kept(store: Store, number: int, seed: int, *, firmware: str = "1.0", minutes: int = 120) -> None:
    """An earlier boot, in the store."""
    points, began = boot(np.random.default_rng(seed)), number * HOUR_NS
    store.add_boot(info(number, firmware=firmware), began)
    rows = zip(points.time, points.bias, points.std, points.temperature_c, strict=True)
    for at, bias, std, celsius in list(rows)[:minutes]:
        state = BiasState(np.concatenate([bias, np.zeros(3)]), np.diag([*std, 1, 1, 1]) ** 2, at, celsius)
        store.save_bias(NAME, number, began + round(at * 1e9), state, history=True)


def day(hours: float, number: int, seed: int = 2) -> Stream:
    """One boot of a worn device."""
    of = simulate_day(seed, hours, 52.0, boot=number)
    ticks = np.round(of.time_s * 1e6).astype(np.int64)
    gyro, accel, celsius, rate, bias = (
        one.astype(float) for one in (of.gyro, of.accel, of.temperature_c, of.rate, of.bias)
    )
    return Stream(ticks, gyro, accel, celsius, rate, bias, of.truth, of.rate_hz)


def batches(of: Stream, number: int, *, accel: bool = True) -> list[SampleBatch]:
    return of.batches(list(range(52, len(of), 52)), boot=number, accel=accel)


# ---- the store ----------------------------------------------------------------------------------------------------


def test_points_come_back_as_they_were_kept(store: Store) -> None:
    kept(store, 1, seed=1)
    (got,) = store.points(info(9))
    want = boot(np.random.default_rng(1))
    np.testing.assert_allclose(got.time - got.time[0], want.time, atol=1e-3)
    np.testing.assert_allclose(got.bias, want.bias)
    np.testing.assert_allclose(got.std, want.std)
    np.testing.assert_allclose(got.temperature_c, want.temperature_c)


def test_only_earlier_boots_of_the_same_hardware_teach(store: Store) -> None:
    kept(store, 1, seed=1, minutes=5)
    kept(store, 2, seed=2, minutes=6, firmware="2.0")
    assert [len(points.time) for points in store.points(info(9))] == [5]
    assert [len(points.time) for points in store.points(info(9, firmware="2.0"))] == [6]
    assert store.points(info(1)) == []
    assert store.points(replace(info(9), device="other")) == []


def test_the_latest_boots_and_the_first_points_of_each(store: Store) -> None:
    for number in range(1, BOOTS + 3):
        kept(store, number, seed=number, minutes=number)
    assert [len(points.time) for points in store.points(info(99))] == list(range(BOOTS + 2, 2, -1))
    late = 100 * HOUR_NS
    store.add_boot(info(50), late)
    points = [late + i for i in range(POINTS + 10)]
    state = BiasState(np.zeros(6), np.eye(6), 1.0, 20.0)
    with store.database.transaction():
        for time_ns in points:
            store.save_bias(NAME, 50, time_ns, state, history=True)
    assert len(store.points(info(99))[0].time) == POINTS


def test_a_boot_without_temperature_or_points_teaches_nothing(store: Store) -> None:
    store.add_boot(info(1), 1)
    store.add_boot(info(2), 2)
    store.save_bias(NAME, 2, 3, BiasState(np.zeros(6), np.eye(6), 1.0), history=True)
    assert store.points(info(9)) == []


# ---- the session --------------------------------------------------------------------------------------------------


def test_a_second_boot_follows_what_the_first_taught(tmp_path: Path) -> None:
    """Without calibration or accelerometer, so that movement tells it little: the whole way through the record."""
    store, clock = Store(tmp_path / "a.sqlite3"), [0]
    record = Record(store, Tally(), lambda: clock[0])
    device = Device(MemoryBus(MemoryBroker()), "w", NAME, SessionKnobs(), 1.0, 0.0)
    record.boot(info(1))
    for batch in batches(day(0.5, 1), 1, accel=False):
        feed(device.session, [batch])
        clock[0] = round(batch.device_time[-1] * 1e9)
        device.heard = clock[0] / 1e9
        record.checkpoint(device, device.heard)
    found = list[TemperatureLaw]()
    record.earlier.law(device.session, info(2), found.append)
    store.close()
    (law,) = found
    second = day(1 / 6, 2)
    assert error(second, law) < 0.7 * error(second, None)


def error(of: Stream, law: TemperatureLaw | None) -> float:
    """°/s rms, from the end of the first minute's rest on."""
    device, errors = DeviceSession(NAME), []
    first, *rest = batches(of, 2, accel=False)
    device.begin_boot(2, float(first.device_time[0]), None, law)
    for batch in [first, *rest]:
        device.handle(batch)
        end = batch.sequence + len(batch) - 1
        if of.time[end] > 60:
            errors.append(device.tracker.bias - of.bias[end])
    return float(np.degrees(np.sqrt(np.mean(np.square(errors)))))


def test_a_law_is_there_from_the_first_sample_on_and_gone_with_the_next_boot() -> None:
    device, of = DeviceSession(NAME), batches(day(0.01, 1), 1)
    device.begin_boot(1, 0.0, None, LAW)
    device.handle(of[0])
    for batch in of[1:5]:
        device.handle(batch)
    np.testing.assert_allclose(device.tracker.state.x[SLOPE], LAW.slope(23.0), atol=np.radians(0.002))
    device.begin_boot(2, 0.0, None)
    for batch in batches(day(0.01, 2), 2)[:5]:
        device.handle(batch)
    assert device.tracker.state.P[3, 3] > 0.5 * KNOBS.per_kelvin**2


def test_a_law_that_comes_late_is_used_too() -> None:
    device, of = DeviceSession(NAME), batches(day(0.01, 1), 1)
    feed(device, of[:5])
    bias = device.tracker.bias
    device.learnt.expect(LAW)
    state = device.tracker.state
    np.testing.assert_array_equal(state.x[BIAS], bias)
    np.testing.assert_allclose(state.x[SLOPE], LAW.slope(state.temperature_c))


def test_what_was_learnt_of_the_slope_in_this_boot_is_kept_when_the_law_comes() -> None:
    device, of = DeviceSession(NAME), batches(day(0.01, 1), 1)
    feed(device, of[:5])
    before = device.tracker.state
    device.tracker.follow(LAW)
    state = device.tracker.state
    np.testing.assert_array_equal(state.x, before.x)
    np.testing.assert_array_equal(state.P, before.P)
    warmer = device.tracker._filter
    warmer.predict(state.time + 1.0, state.temperature_c + 1.0)
    assert warmer.bent is not None
    np.testing.assert_allclose(warmer.bent[SLOPE], 2 * LAW.quadratic)


@pytest.mark.parametrize("how", ["adopted", "restarted", "calibrated"])
def test_no_law_is_refuted_by_a_slope_that_was_not_learnt_under_it(how: str) -> None:
    """That of a calibrated bias is none before it is learnt: the first second gave up what earlier boots had taught."""
    of = calibration(seed=1, after=[Still(12.0)])
    of = replace(of, temperature_c=np.full(len(of), 25.0))
    before, after = of.batches()[:-100], of.batches()[-100:]
    device = DeviceSession(NAME)
    device.begin_boot(1, 0.0, None, LAW if how == "adopted" else None)
    feed(device, before)
    assert device.calibration is not None
    if how == "adopted":  # where the law is known already; else it is looked up only now
        device.adopt(Remembered(device.calibration, None), device.calibration)
    elif how == "restarted":  # before any checkpoint
        remembered, device = Remembered(device.calibration, None), DeviceSession(NAME)
        device.begin_boot(1, float(after[0].device_time[0]), remembered, None, 25.0)
    if how != "adopted":
        device.learnt.expect(LAW)
    feed(device, after)
    learnt = device.tracker.state
    device.learnt.expect(LAW)  # another bridge has it now
    np.testing.assert_array_equal(device.tracker.state.P, learnt.P)
    assert "temperature law disagrees" not in device.status(0).events
    np.testing.assert_allclose(device.tracker.state.x[SLOPE], LAW.slope(25.0), atol=np.radians(1e-4))


def test_a_wrong_law_is_given_up_and_told_once() -> None:
    of = day(0.2, 1)
    wrong = replace(LAW, linear=of.truth.bias_per_kelvin + np.radians(0.06))
    device, said = DeviceSession(NAME), []
    device.begin_boot(1, 0.0, None, wrong)
    for batch in batches(of, 1):
        said += device.handle(batch).said
    assert device.status(0).events["temperature law disagrees"] == 1
    assert sum("temperature" in words for words in said) == 1
    off = np.degrees(np.abs(device.tracker.bias - of.bias[-1]))
    assert off.max() < 0.1


# ---- the service --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("info_first", [True, False])
def test_the_service_hands_the_law_on(tmp_path: Path, info_first: bool) -> None:
    ward = Ward(tmp_path)
    kept(ward.store, 1, seed=1)
    kept(ward.store, 2, seed=2)
    of = batches(day(0.005, 3), 3)
    ward.send(of[:2], info(3) if info_first else None)
    ward.send(of[2:], None if info_first else info(3))
    tracker = ward.service._devices[NAME].session.tracker
    law = learnt(ward.store.points(info(3)))
    np.testing.assert_allclose(tracker.state.x[SLOPE], law.slope(tracker.thermometer.now), atol=np.radians(0.003))
    ward.kill()


def test_no_sample_waits_for_what_earlier_boots_teach(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ward, go_on = Ward(tmp_path), threading.Event()
    kept(ward.store, 1, seed=1)
    kept(ward.store, 2, seed=2)
    ward.kill()
    clerks: list[Clerk] = []

    def hired(database: Database) -> Clerk:
        clerks.append(Clerk(database))
        return clerks[0]

    def thorough(points: list[Points], knobs: BiasKnobs) -> TemperatureLaw | None:
        assert go_on.wait(20.0)
        return learn(points, knobs)

    monkeypatch.setattr("estimator.service.earlier.learn", thorough)
    ward.start(hired)
    of = batches(day(0.01, 3), 3)
    ward.send(of[:10], info(3))
    tracker = ward.service._devices[NAME].session.tracker
    assert sum(map(len, ward.subscriber)) == sum(map(len, of[:10]))

    def taught() -> bool:
        return tracker._law is not None

    assert not taught()
    go_on.set()
    deadline = time.monotonic() + 20.0
    while not taught() and time.monotonic() < deadline:
        ward.settle()
    law = learnt(ward.store.points(info(3)))
    np.testing.assert_allclose(tracker.state.x[SLOPE], law.slope(tracker.thermometer.now), atol=np.radians(0.003))
    clerks[0].close()
    ward.kill()


def test_a_store_that_fails_teaches_nothing_and_is_counted(tmp_path: Path) -> None:
    store, counts = Store(tmp_path / "a.sqlite3", patient=True), Tally()
    record, session = Record(store, counts, lambda: 0), DeviceSession(NAME)
    store.database.execute("DROP TABLE bias_history")
    store.add_boot(info(1), 1)
    found = list[TemperatureLaw]()
    record.earlier.law(session, info(2), found.append)
    record.tend(0.0)
    assert found == []
    assert counts.as_dict()["store failed"] >= 1
    store.close()


def spread(law: TemperatureLaw) -> Floats:
    return np.sqrt(law.slope_var(28.0))


def test_more_boots_know_more(store: Store) -> None:
    known = []
    for number in (1, 2, 3, 4):
        kept(store, number, seed=number)
        known.append(spread(learnt(store.points(info(9)))))
    assert np.all(known[3] < known[0])
    assert learn([], KNOBS) is None
