"""What is remembered of a device corrects it, until there is a session, as that session would at its beginning."""

import numpy as np
import pytest

from bridge.wire.messages import Quality
from estimator.device_knobs import knobs_of
from estimator.noise_model import load_model
from estimator.remembered import Remembered, correction
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
from estimator.track.bias_filter import BiasState, start
from tests.estimator.test_correction import BIAS, CALIBRATION

KNOBS = knobs_of(load_model("lsm9ds1"), SessionKnobs())
BOOT, KEPT_S = CALIBRATION.boot, 500.0


def kept(std: float = 1e-4, celsius: float = np.nan) -> BiasState:
    return start(
        BIAS, std**2 * np.diag([1.0, 2.0, 3.0]), KEPT_S, KNOBS.track.bias, temperature_c=celsius, powered=KEPT_S - 100.0
    )


@pytest.mark.parametrize(
    ("remembered", "quality"),
    [
        (None, Quality.NONE),
        (Remembered(None, kept()), Quality.BIAS_ONLY),
        (Remembered(None, kept(std=0.5)), Quality.NONE),
        (Remembered(None, kept(), doubted=True), Quality.NONE),
        (Remembered(CALIBRATION, kept()), Quality.GOOD),
        (Remembered(CALIBRATION, kept(), doubted=True), Quality.DEGRADED),
        (Remembered(CALIBRATION, kept(std=0.5)), Quality.DEGRADED),
        (Remembered(CALIBRATION, kept(), age_s=1e4), Quality.DEGRADED),
    ],
)
@pytest.mark.parametrize("passed_s", [-2.0, 0.0, 0.3, 20.0])
def test_it_is_what_the_session_applies(remembered: Remembered | None, quality: Quality, passed_s: float) -> None:
    session = DeviceSession("d", KNOBS, KEPT_S + passed_s)
    session.begin_boot(BOOT, KEPT_S + passed_s, remembered, None, None)
    made = correction(remembered, KEPT_S + passed_s, KNOBS)
    assert made is not None
    assert made.quality is quality
    assert made.same(session.applied)


def test_a_thermometer_that_shows_the_same_changes_nothing() -> None:
    remembered = Remembered(CALIBRATION, kept(celsius=31.0))
    session = DeviceSession("d", KNOBS, KEPT_S + 2.0)
    session.begin_boot(BOOT, KEPT_S + 2.0, remembered, None, 31.0)
    made = correction(remembered, KEPT_S + 2.0, KNOBS)
    assert made is not None
    np.testing.assert_allclose(made.model.bias, session.applied.model.bias, rtol=1e-9)
    np.testing.assert_allclose(made.bias_std, session.applied.bias_std, rtol=1e-6)


def test_of_a_calibration_without_its_bias_only_a_session_can_say() -> None:
    assert correction(Remembered(CALIBRATION, None), KEPT_S, KNOBS) is None
