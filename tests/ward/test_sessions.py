"""Whole sessions through a real serial port, bridge, zenoh and estimator, nothing told but the stream."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bridge.sim.calibration_session import simulate_session
from bridge.sim.virtual_device import VirtualDevice
from bridge.wire.messages import Calibration, CorrectedBatch, Quality, Status, Verdict
from estimator.client import Client
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from estimator.service.store_reader import StoreReader
from tests.ward.parts import numbers, recorded, simulated_session, subscribers, wait

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(180)]
#: the paper's; the other tests of wards use the default
SPEED, METHOD = 25.0, "turn360"


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ward]:
    with Ward(tmp_path_factory.mktemp("ward"), ("nilspod", "virtual"), METHOD) as made:
        made.start("router", "estimator", "bridge")
        made.wait_for_router()
        yield made


def play(ward: Ward, device: VirtualDevice, samples: int) -> tuple[Calibration, list[list[CorrectedBatch]], Status]:
    """Play a device's recording through a ward; its stored calibration, what each of three heard, and its last status."""
    heard, watcher, name = subscribers(ward), Watcher(ward.endpoint, WARD), device.name
    ward.plug(name, device, speed=SPEED, lossless=True)
    try:
        for subscriber in heard:
            wait("the end of the recording", partial(has_heard, subscriber, name, samples), watcher, ward, 60)
        wait("the last status", lambda: watcher.statuses[name].samples_out >= samples, watcher, ward)
        with Client((ward.endpoint,), ward=WARD) as client:
            while not (published := client.calibrations(name)):  # a busy machine is slow to hand over what is kept
                ward.check()
    finally:
        for subscriber in heard:
            subscriber.close(0.5)
        watcher.close()
    store = StoreReader.reading(ward.folder / "truerate.sqlite3")
    stored = store.calibrations(name)
    store.close()
    assert len(stored) == 1
    assert [c.id for c in published] == [stored[0].id]
    assert [subscriber.troubles for subscriber in heard] == [""] * 3
    return stored[0], [batches_of(subscriber, name) for subscriber in heard], watcher.statuses[name]


def batches_of(heard: Subscriber, name: str) -> list[CorrectedBatch]:
    return [batch for (device, _), batches in heard.batches.copy().items() if device == name for batch in batches]


def has_heard(heard: Subscriber, name: str, samples: int) -> bool:
    return sum(map(len, batches_of(heard, name))) >= samples


def everything_once(heard: list[list[CorrectedBatch]], samples: int) -> None:
    """Every subscriber has every sample, in order, exactly once."""
    for batches in heard:
        assert np.array_equal(numbers(batches), np.arange(samples))


@pytest.mark.data
def test_a_real_session_calibrates_from_the_stream_alone(shared_data: Path, ward: Ward) -> None:
    with np.load(shared_data / "imucal" / "ferraris_session.npz") as file:
        gyro, accel, rate_hz = file["gyro_rad_s"], file["accel_m_s2"], float(file["rate_hz"])
    calibration, heard, status = play(ward, recorded("nilspod", gyro, accel, rate_hz), len(gyro))
    assert (calibration.method, calibration.verdict) == (METHOD, Verdict.ACCEPTED)
    assert np.diag(calibration.matrix) == pytest.approx([0.9728, 1.0179, 1.0018], abs=2e-3)
    assert np.degrees(calibration.bias) == pytest.approx([-0.5947, -0.3680, 0.0602], abs=0.02)
    assert sorted(turn.axis for turn in calibration.turns) == [0, 1, 2]
    # Seven changes of pose, one nudge and two quarter turns between the turns: none of them a turn.
    assert status.events["movement ignored"] >= 8
    everything_once(heard, len(gyro))


def test_a_simulated_session_calibrates_from_the_stream_alone(ward: Ward) -> None:
    session = simulate_session(11, rests_s=3.2)
    n = len(session.gyro)
    calibration, heard, status = play(ward, simulated_session("virtual", session), n)
    std = np.sqrt(np.diag(calibration.covariance))
    assert np.all(np.abs(np.diag(calibration.matrix) - session.truth.k) < 4 * std[3:])
    assert np.all(np.abs(calibration.bias - session.bias[0]) < 4 * std[:3])
    everything_once(heard, n)
    assert heard[0][0].quality is Quality.NONE, "corrected samples come from the first one on"
    assert heard[0][-1].quality is Quality.GOOD
    assert status.samples_in == status.samples_out + sum(status.dropped.values()) == n
