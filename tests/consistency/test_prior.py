"""After a reboot that moved its scale, rates by an earlier boot's scale are as far off as they say they may be."""

import numpy as np

from bridge.recording import Recording
from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion_scripts import demo_script
from bridge.sim.sample_source import SimulatedSource
from bridge.wire.messages import Quality
from estimator.offline.corrected_recording import CorrectedRecording
from estimator.offline.recordings import calibrate, correct

_FAST = np.radians(20.0)


def rebooted(seed: int) -> tuple[CorrectedRecording, np.ndarray]:
    """A device's second boot, whose scale is another, by the calibration of its first; and its true rates (n, 3)."""
    source, rng = SimulatedSource(demo_script, DEMO_SPEC, 104.0), np.random.default_rng(seed)
    boots, rates = [], []
    for _ in range(2):
        source.power_up(rng, 1.0)
        parts = [source.read() for _ in range(34)]
        joined = parts[0]
        for part in parts[1:]:
            joined = joined.joined(part)
        boots.append(
            Recording(joined.clock_s, joined.gyro, joined.accel, joined.temperature_c, source.sensor.rate_hz, "")
        )
        rates.append(np.concatenate([part.truth.rate for part in parts if part.truth is not None]))
    made, _ = calibrate(boots[0])
    return correct(boots[1], made, other_boot=True), rates[1]


def test_a_scale_of_another_boot_is_no_surer_than_it_may_be() -> None:
    errors = []
    for seed in range(12):
        found, true = rebooted(seed)
        assert not [words for words in found.said if "disagree" in words], (
            "with a bias or an accelerometer that is well"
        )
        turning = (np.abs(true).max(axis=1) > _FAST) & (found.quality < Quality.GOOD)
        errors.append(np.square((found.rate - true) / found.rate_std)[turning].mean())
    assert 0.3 < np.mean(errors) < 1.5, "30 with a scale that is taken to move by 2 % at the most"
