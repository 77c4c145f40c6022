"""Public recordings of other tools' formats; docs/recording.md has their addresses. The mean rates are of independent readers.

ROS: Debian's rosbag 1.15.15. EuRoC: Python's float. Axivity: struct, by Open Movement's description of the format.
"""

from pathlib import Path

import numpy as np
import pytest

from bridge.recording import load

pytestmark = pytest.mark.data
FILES = {
    "imu.bag": (2040, (-0.0009439744937200136, -0.031015939005360718, -0.15044853943602493)),
    "euroc": (36820, (-0.002331725751173285, 0.021723860072188968, 0.07821335160344975)),
    "ax6_sample.cwa": (10360, (0.018607270039452797, -0.035874219429902696, 0.0015353792045195182)),
}


@pytest.mark.parametrize("name", FILES)
def test_a_public_file_has_the_mean_rates_of_an_independent_reader(name: str, shared_data: Path) -> None:
    path = shared_data / "formats" / name
    if not path.exists():
        pytest.skip(f"the public file is not there ({path})")
    samples, mean = FILES[name]
    recording = load(path)
    assert len(recording) == samples
    assert np.allclose(recording.gyro.mean(axis=0), mean, rtol=0, atol=1e-8)
