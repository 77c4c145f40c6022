"""Is the orientation as sure of tilt and heading as it may be? Simulated errors, drawn as the estimator is told."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.geometry.gyro_model import Floats
from estimator.orientation.attitude import Attitude
from tests.estimator.orientation.test_attitude import KNOWN, Worn, inclination

SEEDS = range(40)


def heading_ratio(worn: Worn, rows: Floats) -> float:
    """Heading error since the first sample by its standard deviation, after a minute."""
    found = Attitude().take(rows, KNOWN)
    error = (found.rotation[-1] * worn.attitude[-1].inv()) * (found.rotation[0] * worn.attitude[0].inv()).inv()
    return float(error.as_rotvec()[2] / found.heading_std[-1])


def test_heading_of_a_gyro_alone_after_a_minute() -> None:
    ratios = []
    for seed in SEEDS:
        worn = Worn(seed)
        attitude = Attitude()
        found = attitude.take(worn.without_accelerometer(), KNOWN)
        start = worn.attitude[0] * found.rotation[0].inv()
        error = (found.rotation[-1] * (start.inv() * worn.attitude[-1]).inv()).as_rotvec()
        ratios += (error / np.sqrt(np.diag(attitude.cov))).tolist()
    inside, rms = np.mean(np.abs(ratios) < 2), np.sqrt(np.mean(np.square(ratios)))
    assert 0.90 <= inside <= 0.99  # 120 ratios: 95 % ± 4 %
    assert 0.85 < rms < 1.15


def test_heading_with_an_accelerometer() -> None:
    ratios = [heading_ratio(worn := Worn(seed), worn.rows) for seed in SEEDS]
    assert np.mean(np.abs(ratios) < 2) >= 0.9
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.2


@pytest.mark.parametrize("swing", [0.0, 0.3, 1.0, 2.0])
def test_tilt(swing: float) -> None:
    inside, ratios = [], []
    for seed in SEEDS[:8]:
        worn = Worn(seed, 30.0, swing=swing)
        found = Attitude().take(worn.rows, KNOWN)
        off = inclination(found, worn.attitude)[worn.time > 5]
        std = found.tilt_std[worn.time > 5]
        inside.append(np.mean(off < 2 * std))
        ratios.append(np.mean((off / std) ** 2))
    assert np.mean(inside) >= 0.93
    assert 0.3 < np.sqrt(np.mean(ratios)) < 1.15


def test_it_can_fail() -> None:
    """Told biases a tenth of the true ones, it is far too sure."""
    told = KNOWN.copy()
    told[12:27] /= 10
    ratios = []
    for seed in SEEDS[:10]:
        worn = Worn(seed)
        found = Attitude().take(worn.without_accelerometer(), told)
        start = worn.attitude[0] * found.rotation[0].inv()
        error: Rotation = found.rotation[-1] * (start.inv() * worn.attitude[-1]).inv()
        ratios.append(error.as_rotvec()[2] / found.heading_std[-1])
    assert np.sqrt(np.mean(np.square(ratios))) > 3
