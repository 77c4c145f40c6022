"""`--per-sample`: each sample is also one ROS 2 message, at its own time, and no reader of ours counts it twice."""

import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from bridge.recording import load
from bridge.recording.mcap_reader import McapReader
from bridge.recording.stretches import Stretch, read
from bridge.ros.imu_rows import WAIT_S, ImuJoin, ImuRows
from bridge.wire import codec, keys
from bridge.wire.messages import OrientationBatch, Quality
from estimator.cli.main import main
from tests.bridge.bus.worlds import eventually
from tests.bridge.recording.crowd import STEP, WARD, Crowd, corrected, samples
from tests.bridge.recording.test_convert import session  # noqa: F401 - a fixture
from tests.bridge.recording.test_record import Run
from tests.memory_bus import MemoryBus
from tests.other_languages import test_node

SECOND_NS = 1_000_000_000
STEP_NS = STEP * 1000
BEGIN_NS = 1_700_000_000 * SECOND_NS
FOXGLOVE = Path(test_node.__file__).parent / "foxglove"


def orientation(device: str, sequence: int, n: int, time_ns: int) -> OrientationBatch:
    of = samples(device, sequence, n, time_ns)
    angle = np.radians(np.arange(sequence, sequence + n))
    quat_wxyz = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=1).astype(np.float32)
    covariance = np.diag([1e-4, 1e-4, 4e-4]).astype(np.float32)
    clock = of.start_time_ns, of.tick_period_s, of.clock_rate, of.ticks
    return OrientationBatch(device, of.boot, sequence, *clock, quat_wxyz, None, covariance, 0, "start", Quality.GOOD)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with --per-sample: three devices, of which one also has an orientation for a while."""
    folder = tmp_path_factory.mktemp("recorded")
    run = Run(folder, wait_s=10.0, per_sample=True)
    with MemoryBus(run.broker) as bus:
        with Crowd(bus, 3) as crowd:
            eventually(lambda: bool(crowd.sent))
        turned = bus.publisher(keys.build(WARD, "orientation", device="late"), cache=99)
        raw = bus.publisher(keys.build(WARD, "raw", bridge="bridge-1", device="late"), cache=99)
        rates = bus.publisher(keys.build(WARD, "corrected", device="late"), cache=99)
        for sequence in range(0, 300, 10):
            at_ns = BEGIN_NS + sequence * STEP_NS
            raw.put(codec.encode_samples(samples("late", sequence, 10, at_ns)))
            for _ in range(2):  # as two estimators do during a takeover
                rates.put(codec.encode_corrected(corrected(samples("late", sequence, 10, at_ns))))
            if 50 <= sequence < 150:
                turned.put(codec.encode_orientation(orientation("late", sequence, 10, at_ns)))
        assert run.record(1.0) == 0
    (path,) = folder.iterdir()
    return path


def shown(path: Path, config: pytest.Config) -> list[dict[str, Any]]:
    """The ROS 2 messages of a file, as the packages decode them that Foxglove uses."""
    script = shutil.copy(FOXGLOVE / "plots.js", test_node.installed(config, FOXGLOVE))
    done = subprocess.run(["node", script, str(path)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def vectors(found: list[dict[str, Any]], name: str, axes: str = "xyz") -> np.ndarray[Any, Any]:
    return np.array([[one["message"][name][axis] for axis in axes] for one in found])


def late(path: Path) -> Stretch:
    (stretch,) = read([path]).stretches["late"]
    return stretch


def copies(path: Path) -> Counter[str]:
    """Number of messages of each topic, by the reader of the `mcap` package."""
    with path.open("rb") as file:
        return Counter(
            channel.topic
            for schema, channel, _ in make_reader(file).iter_messages()
            if schema and schema.encoding == "ros2msg"
        )


@pytest.mark.timeout(300)  # npm may have to install them
def test_foxgloves_own_packages_read_one_series_an_axis_at_sample_times(
    recorded: Path, pytestconfig: pytest.Config
) -> None:
    of = late(recorded)
    found = [one for one in shown(recorded, pytestconfig) if one["topic"] == f"/{WARD}/late/imu"]
    stamps = [one["message"]["header"]["stamp"] for one in found]
    assert [stamp["sec"] * SECOND_NS + stamp["nanosec"] for stamp in stamps] == of.time_ns.tolist()
    assert [int(one["logTime"]) for one in found] == of.time_ns.tolist()
    assert {one["message"]["header"]["frame_id"] for one in found} == {"late"}
    assert of.accel is not None
    assert (vectors(found, "angular_velocity") == of.computed["rate_rad_s"]).all()
    assert (vectors(found, "linear_acceleration") == of.accel).all()
    variance = np.array([one["message"]["angular_velocity_covariance"] for one in found])
    assert np.allclose(variance[:, ::4], of.computed["rate_std_rad_s"].astype(float) ** 2, rtol=1e-6)
    known = np.array([one["message"]["orientation_covariance"][0] >= 0 for one in found])
    assert (np.flatnonzero(known) == np.arange(50, 150)).all()  # REP-145: -1 where it is unknown
    assert np.allclose(vectors(found, "orientation", "wxyz")[known], of.computed["quat_wxyz"][known], atol=1e-7)


def test_our_readers_count_each_sample_once(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    of = read([recorded])
    assert of.trouble == []
    with recorded.open("rb") as file:
        reader = McapReader(file, "it")
        batches = sum(1 for entry in reader.entries() if entry.schema.startswith("truerate."))
        assert reader.messages > batches
    found = copies(recorded)
    for device, stretches in of.stretches.items():
        assert found[f"/{WARD}/{device}/imu_raw"] == sum(map(len, stretches))
        assert found[f"/{WARD}/{device}/imu"] == sum(map(len, stretches))
    assert main(["recording", "info", str(recorded), "--json"]) == 0
    assert "foreign" not in capsys.readouterr().out


def test_samples_are_added_to_a_copy_of_a_recording_once(recorded: Path, tmp_path: Path) -> None:
    again, one = tmp_path / "again.mcap", tmp_path / "one.mcap"
    assert main(["recording", "convert", str(recorded), str(again), "--per-sample"]) == 0
    assert copies(again) == copies(recorded)
    assert late(again).computed["rate_rad_s"].tobytes() == late(recorded).computed["rate_rad_s"].tobytes()
    assert main(["recording", "convert", str(recorded), str(one), "--per-sample", "--device", "late"]) == 0
    assert copies(one) == {f"/{WARD}/late/imu": 300, f"/{WARD}/late/imu_raw": 300}
    assert list(read([one]).stretches) == ["late"]


def test_a_torn_recording_keeps_its_copies(recorded: Path, tmp_path: Path) -> None:
    torn, whole = tmp_path / "torn.mcap.part", tmp_path / "torn.mcap"
    torn.write_bytes(recorded.read_bytes()[:-200])
    assert main(["recording", "recover", str(torn)]) == 0
    assert copies(whole) == copies(recorded)


def test_a_table_becomes_messages_too(session: Path) -> None:  # noqa: F811
    out = session.with_name("out.mcap")
    assert main(["recording", "convert", str(session), str(out), "--device", "chest", "--per-sample"]) == 0
    assert copies(out) == {"/converted/chest/imu_raw": len(load(session))}
    assert len(load(out)) == len(load(session))


def test_what_is_not_possible_is_said(
    session: Path,  # noqa: F811
    recorded: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = str(session.with_name("out.mcap"))
    assert main(["recording", "convert", str(session), str(session.with_name("o.npz")), "--per-sample"]) == 2
    assert "--per-sample messages need a .mcap file" in capsys.readouterr().err
    assert main(["recording", "convert", str(recorded), out, "--per-sample", "--device", "nobody"]) == 1
    assert "nothing of --device 'nobody'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert main(["recording", "convert", str(session), out, "--per-sample"]) == 2
    assert "--per-sample needs another package: pip install 'truerate[ros]'" in capsys.readouterr().err
    assert main(["record", "--ward", "w", "--per-sample"]) == 2
    assert "per_sample needs another package: pip install 'truerate[ros]'" in capsys.readouterr().err


def rows(join: ImuJoin, *said: Any, now_s: float = 0.0) -> list[ImuRows]:
    return [made for one in said for made in join.take(one, now_s)]


def test_a_sample_waits_for_its_orientation_but_not_for_ever() -> None:
    join, at_ns = ImuJoin(), BEGIN_NS
    first, second = (samples("a", sequence, 10, at_ns + sequence * STEP_NS) for sequence in (0, 10))
    (alone,) = rows(join, corrected(first))
    assert np.isnan(alone.quat_wxyz).all()  # no device with an orientation is known: nothing to wait for
    assert np.isnan(alone.accel).all()
    assert rows(join, first, orientation("a", 0, 10, at_ns), corrected(second), second) == []
    (complete,) = rows(join, orientation("a", 10, 10, at_ns + 10 * STEP_NS))
    assert (complete.accel == second.accel).all()
    assert np.isfinite(complete.quat_wxyz).all()
    third = samples("a", 20, 10, at_ns + 20 * STEP_NS)
    assert rows(join, corrected(third), third) == []
    assert join.due(0.9 * WAIT_S) == []
    (late,) = join.due(1.1 * WAIT_S)
    assert np.isnan(late.quat_wxyz).all()
    assert (late.accel == third.accel).all()
