"""Whole sessions through a real serial port, bridge, zenoh and estimator, nothing told but the stream."""

from pathlib import Path

import numpy as np
import pytest

from bridge.sim.calibration_session import simulate_session
from bridge.sim.virtual_device import VirtualDevice
from bridge.wire.messages import Calibration, Quality, Verdict
from estimator.calibration.method_names import DEFAULT
from estimator.client import Client
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from estimator.service.store import Store
from tests.ward.parts import numbers, recorded, simulated_session, subscribers, wait

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(180)]
SPEED = 25.0


def play(
    folder: Path, device: VirtualDevice, samples: int, method: str = DEFAULT
) -> tuple[Calibration, list[Subscriber], Watcher]:
    """Play a device's recording through a ward; the stored calibration and what everybody heard."""
    with Ward(folder, (device.name,), method) as ward:
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        heard, watcher = subscribers(ward), Watcher(ward.endpoint, WARD)
        ward.plug(device.name, device, speed=SPEED, lossless=True)
        try:
            wait("the end of the recording", lambda: sum(heard[0].received.values()) >= samples, watcher, ward, 60)
            wait("the last status", lambda: watcher.statuses[device.name].samples_out >= samples, watcher, ward)
            with Client((ward.endpoint,), ward=WARD) as client:
                published = client.calibrations(device.name)
        finally:
            for subscriber in heard:
                subscriber.close()
            watcher.close()
    store = Store(folder / "truerate.sqlite3")
    stored = store.calibrations(device.name)
    store.close()
    assert len(stored) == 1
    assert [c.id for c in published] == [stored[0].id]
    return stored[0], heard, watcher


def everything_once(heard: list[Subscriber], samples: int) -> None:
    """Every subscriber has every sample, in order, exactly once, and nothing to complain of."""
    for subscriber in heard:
        [batches] = subscriber.batches.values()
        assert np.array_equal(numbers(batches), np.arange(samples))
        assert subscriber.troubles == ""


@pytest.mark.data
def test_a_real_session_calibrates_from_the_stream_alone(shared_data: Path, tmp_path: Path) -> None:
    method = "turn360"
    with np.load(shared_data / "imucal" / "ferraris_session.npz") as file:
        gyro, accel, rate_hz = file["gyro_rad_s"], file["accel_m_s2"], float(file["rate_hz"])
    calibration, heard, watcher = play(tmp_path, recorded("nilspod", gyro, accel, rate_hz), len(gyro), method)
    assert (calibration.method, calibration.verdict) == (method, Verdict.ACCEPTED)
    assert np.diag(calibration.matrix) == pytest.approx([0.9728, 1.0179, 1.0018], abs=2e-3)
    assert np.degrees(calibration.bias) == pytest.approx([-0.5947, -0.3680, 0.0602], abs=0.02)
    assert sorted(turn.axis for turn in calibration.turns) == [0, 1, 2]
    # Seven changes of pose, one nudge and two quarter turns between the turns: none of them a turn.
    assert watcher.statuses["nilspod"].events["movement ignored"] >= 8
    everything_once(heard, len(gyro))


def test_a_simulated_session_calibrates_from_the_stream_alone(tmp_path: Path) -> None:
    session = simulate_session(11, rests_s=3.2)
    n = len(session.gyro)
    calibration, heard, watcher = play(tmp_path, simulated_session("virtual", session), n)
    std = np.sqrt(np.diag(calibration.covariance))
    assert np.all(np.abs(np.diag(calibration.matrix) - session.truth.k) < 4 * std[3:])
    assert np.all(np.abs(calibration.bias - session.bias[0]) < 4 * std[:3])
    everything_once(heard, n)
    [batches] = heard[0].batches.values()
    assert batches[0].quality is Quality.NONE, "corrected samples come from the first one on"
    assert batches[-1].quality is Quality.GOOD
    status = watcher.statuses["virtual"]
    assert status.samples_in == status.samples_out + sum(status.dropped.values()) == n
