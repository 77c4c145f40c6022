"""An accelerometer is calibrated by the rests of a boot, whatever they are for, and levels the orientation better."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.reasons.codes import Code
from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion import Piece, Still
from bridge.sim.motion_scripts import poses, swing
from bridge.wire.messages import Quality, Verdict
from estimator.device.session import DeviceSession
from estimator.offline.recordings import calibrate, correct
from tests.estimator.device.session.lives import calibrated
from tests.estimator.stream import NAME, Stream, calibration, feed
from tests.sentences import codes

WRONG = replace(DEMO_SPEC, accel_bias=0.4, accel_scale=0.02)


def laid_about() -> list[Piece]:
    """Laid down on every side, then swung about."""
    rng = np.random.default_rng(4)
    return [
        *poses(rng, 14),
        Still(2.0),
        *(p for _ in range(5) for p in (swing(rng, 3.0, np.radians(60.0)), Still(2.0))),
    ]


@pytest.fixture(scope="module")
def life() -> Stream:
    """Calibrated by three turns, then laid down in fifteen poses, then swung about."""
    return calibration(seed=1, after=laid_about(), spec=WRONG)


def near(life: Stream, device: DeviceSession) -> bool:
    """Whether the status tells the true errors, within four standard deviations of each."""
    found = device.status(0).accelerometer
    assert found is not None
    true = np.array([*life.truth.accel_bias, *1 / life.truth.accel_scale])
    return bool((np.abs(true - [*found.bias, *found.scale]) < 4 * np.array(found.std)).all())


def test_rests_while_worn_calibrate_it(life: Stream) -> None:
    device, said = DeviceSession(NAME), []
    for batch in life.batches():
        feed(device, [batch])
        said.append(device.status(0).accelerometer)
    assert said[10] is None
    counts = [one.poses for one in said if one is not None]
    assert counts == sorted(counts)
    assert Code.TOO_FEW_POSES in {code for one in said if one is not None for code in codes(one.reason)}
    last = said[-1]
    assert last is not None
    assert last.verdict is Verdict.ACCEPTED
    assert max(last.std[:3]) < 0.02
    assert near(life, device)
    device.start_over(())
    assert device.status(0).accelerometer is None, "another device, for all that is known"


def test_the_gyro_is_as_good_without(life: Stream) -> None:
    """Readings that cannot be gravity are refused with the reason; what the gyro is worth does not change."""
    dead = replace(life, accel=np.full_like(life.accel, 3.0))
    device, other = calibrated(life), calibrated(dead)
    assert device.applied.quality is other.applied.quality is Quality.GOOD
    assert other.status(0).accelerometer is None


def test_the_vertical_is_nearer_the_truth_with_it(life: Stream) -> None:
    recording = replace(life.recording(), time_s=life.time - life.time[0])
    result, _ = calibrate(recording)
    assert result.accelerometer is not None
    assert result.accelerometer.verdict is Verdict.ACCEPTED

    def off(with_it: bool) -> tuple[float, float]:
        """rms angle between the true and the estimated vertical in the last ten seconds, and its standard deviation."""
        known = result if with_it else replace(result, accelerometer=None)
        # Without the poses, so that the calibration given is all that is known.
        late = life.only(slice(life.at(life.time[-1] - 30.0), None))
        found = correct(replace(late.recording(), time_s=late.time - late.time[0]), known)
        up = [one.inv().apply([0.0, 0.0, 1.0]) for one in (found.rotation, truth(late))]
        angle = np.linalg.norm(np.cross(*up), axis=1)[-1000:]
        return float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(found.tilt_std[-1000:].astype(float) ** 2)))

    (left, std), (right, sure) = off(False), off(True)
    assert right < left / 3
    assert sure < std
    assert right < 2 * sure


def truth(life: Stream) -> Rotation:
    return Rotation.from_quat(life.attitude, scalar_first=True)
