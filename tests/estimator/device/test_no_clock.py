"""A device that tells no time and is said to have a rate it does not have: its scale factor comes out right all the same."""

import numpy as np
import pytest

from bridge.drivers.driver import Identity, Readings
from bridge.ingest.intake import Intake
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import SessionPlan
from bridge.wire.messages import BootCause, Verdict
from estimator.device.session import DeviceSession
from tests.estimator.stream import NAME, calibration, feed

NOW = 1_700_000_000 * 10**9


@pytest.mark.parametrize(("told_hz", "waits_s"), [(104.0, 3.0), (100.0, 20.0), (208.0, 3.0), (52.0, 20.0)])
def test_a_wrong_rate_is_no_wrong_scale(told_hz: float, waits_s: float) -> None:
    rng = np.random.default_rng(5)
    of = calibration(seed=5, before_s=waits_s, after=[Still(5.0)], plan=SessionPlan(turn_s=(4.0, 5.0)))
    intake, device, said = Intake(NAME, "b", "text", "p"), DeviceSession(NAME), []
    intake.take(
        Identity(1, BootCause.PORT_OPENED, "m", "f", told_hz, 0.0, 1 / told_hz, False, False, 64, 64, has_clock=False)
    )
    for a in range(0, len(of) - 5, 5):
        ticks = np.arange(a, a + 5, dtype=np.uint64)
        at_ns = NOW + round((of.time[a + 4] + rng.exponential(0.003)) * 1e9)
        for batch in intake.take(Readings(1, a, at_ns, ticks, of.gyro[a : a + 5], None, None)):
            said += feed(device, [batch]).calibrations
    assert said[-1].verdict is Verdict.ACCEPTED, said[-1].reason
    np.testing.assert_allclose(np.diag(said[-1].matrix), of.truth.k, rtol=2e-3)
