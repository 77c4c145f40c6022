"""Public recordings of other tools' formats; docs/recording.md has their addresses. The mean rates are of independent readers.

ROS 1: Debian's rosbag 1.15.15. ROS 2: sqlite3 and mcap, with the rates taken from the CDR by struct. EuRoC: Python's float.
Axivity: struct, by Open Movement's description of the format. XDF: struct, by the specification. Parquet: the .csv of the
same samples beside it, whose numbers are rounded.
"""

from pathlib import Path

import numpy as np
import pytest

from bridge.recording import Reading, load

pytestmark = pytest.mark.data
FILES = {
    "imu.bag": (2040, (-0.0009439744937200136, -0.031015939005360718, -0.15044853943602493)),
    "bag_20251201_084529_0.db3": (37, (4.717102102102103e-05, -4.245391891891892e-06, -3.1604584084084075e-05)),
    "SO_lastbag_mcap_0.mcap": (1196, (-1.1989571986780314, 0.6154882910857847, -2.0415098748914264)),
    "euroc": (36820, (-0.002331725751173285, 0.021723860072188968, 0.07821335160344975)),
    "ax6_sample.cwa": (10360, (0.018607270039452797, -0.035874219429902696, 0.0015353792045195182)),
    "sub-P002_ses-S001_task-Default_run-001_eeg.xdf": (
        882,
        (-0.002087177095566801, 0.031351888079976444, -0.00163665896197392),
    ),
    "example_data_2min.parquet": (10360, (0.01860726911766926, -0.03587421704676366, 0.0015353785152748046)),
}
#: what the file does not say
OPTIONS = {"example_data_2min.parquet": Reading(gyro_unit="deg/s")}


@pytest.mark.parametrize("name", FILES)
def test_a_public_file_has_the_mean_rates_of_an_independent_reader(name: str, shared_data: Path) -> None:
    path = shared_data / "formats" / name
    if not path.exists():
        pytest.skip(f"the public file is not there ({path})")
    samples, mean = FILES[name]
    recording = load(path, reading=OPTIONS.get(name, Reading()))
    assert len(recording) == samples
    assert np.allclose(recording.gyro.mean(axis=0), mean, rtol=0, atol=1e-8)
