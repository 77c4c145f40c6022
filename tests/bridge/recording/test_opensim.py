"""`truerate recording convert IN OUT.sto`: what OpenSim reads of it, against a rotation that is known in closed form.

OpenSim is large. Where it is not installed its tests are skipped: `pip install --group opensim` installs it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from estimator.cli.main import main

BEGIN_NS = 1_790_000_000_000_000_000
#: turns truerate's earth, z up, to OpenSim's ground, y up: the page on OpenSim tells people to give it
SENSOR_TO_OPENSIM = (-np.pi / 2, 0.0, 0.0)
#: how the sensor lies on its segment, in the closed form
ON_SEGMENT = Rotation.from_rotvec([0.4, -1.1, 0.7])


def bent(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle of a hinge, rad."""
    return np.asarray(0.8 * np.sin(1.7 * time_s))


def of_hinge(time_s: NDArray[np.float64]) -> Rotation:
    """Sensor to earth, z up, of a segment on a hinge about OpenSim's z."""
    in_ground = Rotation.from_rotvec(np.outer(bent(time_s), [0.0, 0.0, 1.0])) * ON_SEGMENT
    return Rotation.from_euler("xyz", SENSOR_TO_OPENSIM).inv() * in_ground


def of_turning(time_s: NDArray[np.float64]) -> Rotation:
    """Sensor to earth, of one that turns evenly about a fixed axis, so that every interpolation along it is exact."""
    return Rotation.from_rotvec(np.outer(time_s, [0.3, -0.9, 0.5])) * ON_SEGMENT


def save(path: Path, device: str, turned: Any, rate_hz: float, begin_s: float, end_s: float) -> Path:
    """A recording as `truerate recording export --npz` writes it, with a hole of half a second at 2 s if it is called `torn`."""
    time_s = np.arange(begin_s, end_s, 1 / rate_hz)
    if path.stem == "torn":
        time_s = time_s[(time_s < 2.0) | (time_s > 2.5)]
    quat = turned(time_s).as_quat(scalar_first=True)
    quat *= np.where(np.arange(len(quat)) % 3, 1, -1)[:, None]  # both signs are the same rotation
    np.savez(
        path,
        gyro_rad_s=np.zeros((len(time_s), 3)),
        rate_rad_s=np.column_stack([np.sin(time_s), np.cos(time_s), time_s]).astype(np.float32),
        quat_wxyz=quat.astype(np.float32),
        host_time_ns=BEGIN_NS + np.rint(time_s * 1e9).astype(np.int64),
        t_s=time_s - begin_s,
        device=np.array(device),
        boot=np.array("0000000000000005"),
    )
    return path


def read(path: Path) -> tuple[dict[str, str], list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Header, columns, times (n,) and numbers (n, columns, components) of an .sto."""
    head, _, body = path.read_text().partition("endheader\n")
    (_, *columns), *rows = (line.split("\t") for line in body.splitlines())
    numbers = np.array([[[float(value) for value in cell.split(",")] for cell in row[1:]] for row in rows])
    return (
        dict(line.split("=") for line in head.splitlines()),
        columns,
        np.array([float(row[0]) for row in rows]),
        numbers,
    )


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    """Two devices whose samples fall at different times, the second begun later."""
    return (
        save(tmp_path / "hinge.npz", "knee", of_hinge, 100.0, 0.0, 6.0),
        save(tmp_path / "torn.npz", "wrist-left", of_turning, 64.0, 1.0037, 5.0),
    )


def test_several_devices_have_common_times(
    two: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "walk.sto"
    words = ["recording", "convert", *map(str, two), str(out), "--segment", "wrist-left=hand_l", "--skip", "0.5"]
    assert main(words) == 0
    head, columns, time_s, quat = read(out)
    time_s += 1.51  # the first sample of the first device half a second after the second has begun
    assert (head["DataRate"], head["DataType"], head["version"]) == ("100.000000", "Quaternion", "3")
    assert columns == ["knee_imu", "hand_l_imu"]
    assert ((time_s < 2.0) | (time_s > 2.49)).all(), "nothing is made up in a gap"
    assert "times are left out: a device has a gap there" in capsys.readouterr().out
    for column, turned in enumerate((of_hinge, of_turning)):
        off = (Rotation.from_quat(quat[:, column], scalar_first=True).inv() * turned(time_s)).magnitude()
        assert off.max() < 1e-6
    head, columns, _, rate = read(tmp_path / "walk_angularVelocity.sto")
    assert (head["DataType"], columns) == ("Vec3", ["knee_imu", "hand_l_imu"])
    np.testing.assert_allclose(rate[:, 0], np.column_stack([np.sin(time_s), np.cos(time_s), time_s]), atol=1e-6)
    np.testing.assert_allclose(rate[:, 1, 2], time_s, atol=1e-6)


def test_what_is_wrong_is_said(two: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hinge, torn = map(str, two)
    bare = tmp_path / "bare.npz"
    np.savez(bare, gyro_rad_s=np.zeros((9, 3)), t_s=np.arange(9.0))
    short = tmp_path / "short.npz"
    np.savez(short, quat_wxyz=np.zeros((8, 4)), t_s=np.arange(9.0))
    later = save(tmp_path / "later.npz", "hip", of_hinge, 100.0, 60.0, 61.0)
    out = str(tmp_path / "walk.sto")
    for words, told in (
        ([str(bare), out], "no orientation: `truerate correct"),
        ([str(short), out], "'quat_wxyz' has shape (8, 4); numbers of shape (9, 4) are needed"),
        ([hinge, hinge, out], "'knee' is in two of the files"),
        ([hinge, str(later), out], "no time in common"),
        ([hinge, out, "--segment", "hip=femur_r"], "no orientation of device 'hip'; devices with orientation: knee"),
        ([hinge, torn, out, "--segment", "wrist-left=knee"], "two devices are on 'knee'"),
        ([hinge, out, "--segment", "knee"], "give DEVICE=BODY"),
        ([hinge, out, "--skip", "6"], "no time in common after --skip 6"),
        ([hinge, torn, str(tmp_path / "walk.npz")], "give one recording"),
    ):
        assert main(["recording", "convert", *words]) != 0
        assert told in capsys.readouterr().err.replace("\n", " ")
        assert not Path(out).exists()


@pytest.fixture
def osim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)  # it writes its log where it is
    return pytest.importorskip("opensim", reason="opensim is not installed: pip install --group opensim")


def test_opensim_reads_the_same_orientations(osim: Any, two: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "walk.sto"
    assert main(["recording", "convert", *map(str, two), str(out)]) == 0
    table = osim.TimeSeriesTableQuaternion(str(out))
    assert table.getColumnLabels() == ("knee_imu", "wrist-left_imu")
    time_s = 1.01 + np.array(table.getIndependentColumn())
    for column, turned in enumerate((of_hinge, of_turning)):
        cells = [table.getRowAtIndex(row).getElt(0, column) for row in range(table.getNumRows())]
        quat = np.array([[cell.get(part) for part in range(4)] for cell in cells])
        assert (Rotation.from_quat(quat, scalar_first=True).inv() * turned(time_s)).magnitude().max() < 1e-6
    rates = osim.TimeSeriesTableVec3(str(tmp_path / "walk_angularVelocity.sto"))
    assert rates.getRowAtIndex(9).getElt(0, 0).get(2) == pytest.approx(time_s[9], abs=1e-6)


def test_opensense_finds_the_angle_of_the_joint(osim: Any, tmp_path: Path) -> None:
    """IMU Placer and inverse kinematics with the rotation of the page on OpenSim give the angle of the hinge."""
    hinge = save(tmp_path / "hinge.npz", "knee", of_hinge, 100.0, 0.0, 3.0)
    out = tmp_path / "walk.sto"
    assert main(["recording", "convert", str(hinge), str(out), "--segment", "knee=torso"]) == 0
    model = osim.Model()
    body = osim.Body("torso", 1.0, osim.Vec3(0), osim.Inertia(1, 1, 1))
    joint = osim.PinJoint("hinge", model.getGround(), body)
    joint.updCoordinate().setName("angle")
    model.addBody(body)
    model.addJoint(joint)
    model.finalizeConnections()
    bare, placed = tmp_path / "bare.osim", tmp_path / "placed.osim"
    model.printToXML(str(bare))
    turn = osim.Vec3(*SENSOR_TO_OPENSIM)
    placer = osim.IMUPlacer()
    placer.set_model_file(str(bare))
    placer.set_orientation_file_for_calibration(str(out))
    placer.set_sensor_to_opensim_rotations(turn)
    placer.set_output_model_file(str(placed))
    assert placer.run(False)
    tool = osim.IMUInverseKinematicsTool()
    tool.set_model_file(str(placed))
    tool.set_orientations_file(str(out))
    tool.set_sensor_to_opensim_rotations(turn)
    tool.set_results_directory(str(tmp_path))
    assert tool.run(False)
    found = osim.TimeSeriesTable(str(next(tmp_path.glob("ik_*.mot"))))
    time_s, angle = np.array(found.getIndependentColumn()), found.getDependentColumn("angle")
    degrees = np.array([angle[row] for row in range(len(time_s))])
    np.testing.assert_allclose(np.radians(degrees), bent(time_s), atol=1e-3)
