"""A device that is silent for a while, then heard again in another pose: nothing breaks, and it can be calibrated."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.sim.calibration_session import simulate_session
from bridge.wire.messages import SampleBatch, Verdict
from estimator.device.session import DeviceSession


@pytest.mark.parametrize("hole_s", [1.0, 60.0, 119.0, 121.0, 3600.0])
def test_a_hole_of_any_length_in_a_rest_harms_nothing(hole_s: float) -> None:
    session = simulate_session(5)
    device = DeviceSession("chest")
    device.begin_boot(1, 0.0, None)
    rest = int(6.0 * session.rate_hz)
    ticks = np.arange(1, rest + 1) * 9615
    still = np.tile(session.gyro[:1], (rest, 1)) + 1e-4 * np.random.default_rng(1).normal(size=(rest, 3))
    later = ticks[-1] + int(hole_s * 1e6) + session.ticks
    outcomes = [
        device.handle(raw(still, ticks, 0)),
        *(device.handle(raw(session.gyro[i : i + 5], later[i : i + 5], rest + i)) for i in range(0, len(later), 5)),
    ]
    calibrations = [made for outcome in outcomes for made in outcome.calibrations]
    assert [c.verdict for c in calibrations] == [Verdict.ACCEPTED]
    assert np.diag(calibrations[0].matrix) == pytest.approx(session.truth.k, abs=2e-3)


def raw(gyro: NDArray[np.float64], ticks: NDArray[np.int64], sequence: int) -> SampleBatch:
    n = len(gyro)
    return SampleBatch(
        device="chest",
        boot=1,
        sequence=sequence,
        receive_time_ns=0,
        start_time_ns=0,
        tick_period_s=1e-6,
        clock_rate=1.0,
        ticks=ticks[:n].astype(np.uint64),
        gyro=gyro.astype(np.float32),
        accel=None,
        temperature_c=None,
        flags=np.zeros(n, np.uint32),
    )
