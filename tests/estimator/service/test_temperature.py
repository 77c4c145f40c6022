"""What temperature does is learnt in one boot, kept, and used in the next: sessions and store as the service has them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.wire.messages import SampleBatch
from bridge.wire.refusal import Tally
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.service.checkpoints import Checkpoints
from estimator.service.device import Device
from estimator.service.store import Store
from estimator.service.store_access import StoreAccess
from estimator.service.store_writer import StoreWriter
from estimator.tracking.bias_state import SLOPE, BiasState
from estimator.tracking.temperature_law import TemperatureLaw
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, feed, handle, info
from tests.estimator.tracking.test_temperature_law import LAW, boot, learnt
from tests.memory_bus import MemoryBroker, MemoryBus
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


# ---- the session --------------------------------------------------------------------------------------------------


def test_a_second_boot_follows_what_the_first_taught(tmp_path: Path) -> None:
    """Without calibration or accelerometer, so that movement tells it little: the whole way through the record."""
    store, clock = Store(tmp_path / "a.sqlite3"), [0]
    clerk = StoreWriter(store.database, thread=False)
    record = StoreAccess(
        store, Tally(), lambda: clock[0], clerk, Checkpoints(0), lambda _: None, lambda _, work: work()
    )
    device = Device(MemoryBus(MemoryBroker()), "w", NAME, SessionKnobs(), 1.0, 0.0)
    record.boot(info(1))
    for batch in batches(day(0.5, 1), 1, accel=False):
        feed(device.session, [batch])
        clock[0] = round(batch.device_time[-1] * 1e9)
        device.heard = clock[0] / 1e9
        record.checkpoint(device, device.heard)
    found = list[TemperatureLaw | None]()
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
        handle(device, batch)
        end = batch.sequence + len(batch) - 1
        if of.time[end] > 60:
            errors.append(device.tracker.bias - of.bias[end])
    return float(np.degrees(np.sqrt(np.mean(np.square(errors)))))


def test_a_wrong_law_is_given_up_and_told_once() -> None:
    of = day(0.2, 1)
    wrong = replace(LAW, linear=of.truth.bias_per_kelvin + np.radians(0.06))
    device, said = DeviceSession(NAME), []
    device.begin_boot(1, 0.0, None, wrong)
    for batch in batches(of, 1):
        said += handle(device, batch).said
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
