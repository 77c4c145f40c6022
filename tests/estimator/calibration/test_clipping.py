"""Readings cut off at the end of a gyro's range, told or not."""

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion_scripts import SessionPlan
from bridge.wire.messages import Verdict
from estimator.calibration.capture import Samples
from estimator.calibration.clipping import clipped
from estimator.config.device_settings import knobs_of
from estimator.device.session import DeviceSession
from estimator.noise.device_model import load_model
from estimator.offline import recordings
from tests.estimator.calibration.pushed_turns import SHAPES, Case, session
from tests.estimator.stream import NAME, calibration, feed
from tests.sentences import codes

RANGE, NOISE, STEP = np.radians(250.0), np.radians(0.05), np.radians(250.0) / 32768
CUT, GOOD = Case(250.0, cut=True, noise_dps=0.05), Case(2000.0, cut=False, noise_dps=0.01)


def push(peak_dps: float, *, cut: bool = True, after: float = 0.0) -> Samples:
    """One push about x, 3 s long, with the gyro's noise, cut off at the range; after: rad/s of noise behind the cut."""
    rng = np.random.default_rng(1)
    time = np.arange(312) / 104.0
    rate = np.radians(peak_dps) * np.sin(np.pi * time / time[-1]) ** 2
    gyro = rate[:, None] * np.array([1.0, 0.02, 0.0]) + NOISE * rng.normal(size=(len(time), 3))
    gyro = STEP * np.round((np.clip(gyro, -RANGE, RANGE) if cut else gyro) / STEP)
    return Samples(time, gyro + after * rng.normal(size=gyro.shape), None, np.zeros(len(time), bool))


def cut_off(samples: Samples, gyro_range: float = np.inf) -> int:
    """How many samples."""
    return int(np.count_nonzero(clipped(samples, np.full(3, NOISE), gyro_range)))


def test_the_readings_show_it_where_no_range_is_told() -> None:
    assert cut_off(push(400.0)) > 50
    assert cut_off(push(240.0)) == 0


def test_a_told_range_counts_from_99_percent_on() -> None:
    assert cut_off(push(249.0), RANGE) > 0
    assert cut_off(push(245.0), RANGE) == 0


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_of_push(shape: str) -> None:
    for seed in range(2):
        result, passed_over = recordings.calibrate(session(seed, shape, CUT)[0])
        assert result.verdict is not Verdict.ACCEPTED
        assert any("too fast for the gyro's range" in words for words in passed_over)
        recording, k = session(seed, shape, GOOD)
        result, _ = recordings.calibrate(recording)
        assert result.verdict is Verdict.ACCEPTED, "a quiet gyro of ±2000 °/s repeats its readings and is not cut off"
        assert np.all(np.abs(result.scale - k) < 4 * result.scale_std)


def test_a_device_model_tells_the_range_live_too() -> None:
    """Turns at 248.5 °/s: near the end of what an ICM-20948 reads at ±250 °/s, and nothing to a device of ±2000."""
    plan = SessionPlan(turn_s=(2.716, 2.716))
    of = calibration(seed=2, spec=ImuSpec(scale=(1.0, 1.0), noise_dps=0.02, bias_limit_dps=0.1), plan=plan)
    near, far = (DeviceSession(NAME, knobs_of(load_model(model))) for model in ("icm-20948", "generic"))
    for device in (near, far):
        feed(device, of.batches())
    assert near.calibration is None
    assert Code.TOO_FAST in codes(near.status(1).reason)
    assert far.calibration is not None
