"""A ward's recording played again through drivers, intake and pump: devices, boots and gaps as they were."""

import time
from pathlib import Path

import msgspec
import numpy as np
import pytest

from bridge.config.schema import Bridge, Device
from bridge.drivers import replayed
from bridge.drivers.replayed import Playback, ReplayedDriver, ReplayedOptions, ReplaySegment
from bridge.ingest.pump import Pump
from bridge.recording import Reading
from bridge.recording.files import Folder
from bridge.recording.reading import as_table
from bridge.recording.recorder import WardRecorder
from bridge.recording.stretches import Stretch, read
from bridge.transport.errors import DeviceUnavailable
from bridge.wire import keys
from bridge.wire.messages import SampleFlag
from tests.bridge.recording.crowd import STEP, TICK_S, WARD
from tests.bridge.recording.test_contents import SETTINGS, S, about, recorded, run
from tests.memory_bus import MemoryBroker, MemoryBus

SPEED = 10.0


def replay(path: Path, out: Path) -> dict[str, list[Stretch]]:
    """What a recorder has of a ward that is played from a file."""
    broker = MemoryBroker()
    subscription = MemoryBus(broker).subscribe(keys.everything(WARD))
    tables = [
        {"id": name, "driver": "replayed", "file": str(path), "speed": SPEED, "recorded_device": name}
        for name in replayed.devices(path)
    ]
    recorder = WardRecorder(Folder(out, WARD), WARD, SETTINGS)
    recorder.begin(time.time_ns(), 0.0)
    bridge = Bridge(id="replay", batch_ms=20, devices=tuple(Device.from_table(table) for table in tables))
    with Pump(WARD, bridge, MemoryBus(broker)) as ward:
        while not ward.over:
            recorder.take(subscription.drain(1000, 0.02), time.time_ns(), 0.0)
    recorder.take(subscription.drain(100_000, 0.1), time.time_ns(), 0.0)
    recorder.close()
    return read(recorder.account.files).stretches


def test_a_ward_is_played_as_it_was(tmp_path: Path) -> None:
    part = [about("one"), *run("one", 0, 200), *run("one", 230, 400), about("one", 8)]
    part += [*run("one", 0, 100, boot=8, later_ns=8 * S), *run("two", 0, 150, later_ns=S)]
    (path,) = recorded(tmp_path, part)
    was, now = read([path]).stretches, replay(path, tmp_path)
    assert list(now) == list(was)
    for name, befores in was.items():
        assert len(now[name]) == len(befores)
        for before, after in zip(befores, now[name], strict=True):
            np.testing.assert_array_equal(after.sequence - after.sequence[0], before.sequence - before.sequence[0])
            np.testing.assert_array_equal(after.gyro, before.gyro)
            np.testing.assert_array_equal(np.diff(after.ticks), np.diff(before.ticks))
            flags = after.flags & ~np.uint32(SampleFlag.LATE)  # as on a busy machine
            assert (flags == before.flags)[1:].sum() >= len(before) - 2  # the hole is marked now
            assert after.boot != before.boot, "another number, or subscribers would take the samples for repeats"
            assert after.info is not None
            assert (after.rate_hz, after.tick_period_s) == (before.rate_hz, before.tick_period_s)
    one, two = (now[name][0].info for name in ("one", "two"))
    assert one is not None
    assert (one.model, one.firmware, one.gyro_range, one.events["missing_samples"]) == ("lsm9ds1", "1.0", 8.7, 30)
    assert two is not None
    assert now["one"][0].boot != now["one"][1].boot
    # Each device's thread begins to play when the machine lets it: the test below holds what is due when.
    assert now["one"][0].time_ns[0] < now["one"][1].time_ns[0]


def test_every_sample_is_due_when_it_was_taken(tmp_path: Path) -> None:
    part = [*run("one", 0, 100), *run("one", 0, 50, boot=8, later_ns=8 * S), *run("two", 0, 100, later_ns=S)]
    found = read(recorded(tmp_path, part))
    first, second, other = (
        ReplaySegment.of_stretch(stretch, found.begin_ns, salt=5)
        for name in ("one", "two")
        for stretch in found.stretches[name]
    )
    np.testing.assert_allclose(first.due_s, np.arange(100) * STEP * TICK_S, atol=1e-9)
    np.testing.assert_allclose(second.due_s, 8 + np.arange(50) * STEP * TICK_S, atol=1e-9)
    np.testing.assert_allclose(other.due_s, 1 + np.arange(100) * STEP * TICK_S, atol=1e-9)
    playback = Playback([first, second], 4.0)
    assert len(playback.due(0.1, 1)) == 2, "who it is, and what was taken in the first 0.4 s"
    playback.due(1.9, 1)
    assert playback.wait_s(1.9) == pytest.approx(0.1)
    assert playback.due(1.99, 1) == []
    assert [type(event).__name__ for event in playback.due(2.0, 1)] == ["Identity", "Readings"]


def test_one_of_several_must_be_said(tmp_path: Path) -> None:
    (path,) = recorded(tmp_path, [*run("one", 0, 20), *run("two", 0, 20)])
    with pytest.raises(DeviceUnavailable, match="recorded_device to one of one, two"):
        ReplayedDriver(ReplayedOptions(file=str(path))).open()
    with pytest.raises(DeviceUnavailable, match="no samples of recorded_device 'three'; choose from one, two"):
        ReplayedDriver(ReplayedOptions(file=str(path), recorded_device="three")).open()
    ReplayedDriver(ReplayedOptions(file=str(path), recorded_device="two")).open()


def test_a_table_of_another_tool_is_played_as_its_options_say(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,x,y,z\n" + "".join(f"{20 * i},131,0,-262\n" for i in range(50)))
    told = Reading(columns=("x", "y", "z"), gyro_sensitivity=131.0)
    options = msgspec.convert({"file": str(path), **as_table(told)}, ReplayedOptions)
    driver = ReplayedDriver(options)
    driver.open()
    take = replayed._takes(options)[0]
    assert np.allclose(np.degrees(take.gyro), [1, 0, -2])
    assert take.identity.rate_hz == pytest.approx(50)
    with pytest.raises(DeviceUnavailable, match="--gyro-unit"):
        ReplayedDriver(ReplayedOptions(file=str(path), columns=("x", "y", "z"))).open()
