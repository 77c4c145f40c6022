"""A bridge end to end: devices on terminals, unplugged, rebooted, over a bus that comes and goes."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bridge.config.schema import Bridge, Device
from bridge.drivers.replayed import ReplayedOptions
from bridge.drivers.simulated import SimulatedOptions
from bridge.ingest.device_thread import DeviceThread, Taken
from bridge.ingest.pump import Pump
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, Quality, SampleFlag, State, Status
from tests.bridge.ingest.published.hearing import Listener, accounted, native, published, unbroken
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import codes

ALIVE = "truerate/@v1/w/alive/"


def test_devices_are_published_whole_with_their_account_and_their_tokens(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with (
        PtyPort(demo_device("d1", 1), tmp_path / "d1", lossless=True) as one,
        PtyPort(demo_device("d2", 2), tmp_path / "d2", lossless=True) as two,
    ):
        config = Bridge(id="b1", batch_ms=20, devices=(native(one), native(two, "d2")))
        with MemoryBus(broker) as bus, Pump("w", config, bus):
            listener.until(lambda: listener.count() > 100 and listener.count("d2") > 100)
            boots = [keys.boot_id(port.device.boot or 0) for port in (one, two)]
            alive = {"bridge/b1", f"device/d1/{boots[0]}", f"device/d2/{boots[1]}"}
            listener.until(
                lambda: {key for key, there in listener.alive if there} == {f"{ALIVE}{one}" for one in alive}
            )
        listener.hear()
        listener.until(lambda: [there for _, there in listener.alive].count(False) == 3)
    for device in ("d1", "d2"):
        listener.until(partial(accounted, listener, device))
        assert unbroken(listener.batches[device])
        info = listener.infos[device]
        assert (info.dropped, info.driver, info.bridge) == ({}, "native", "b1")
        assert info.boot == listener.batches[device][0].boot


def test_a_reboot_is_a_new_boot_with_a_new_token(tmp_path: Path, broker: MemoryBroker, listener: Listener) -> None:
    with published(tmp_path, broker) as port:
        listener.until(lambda: listener.count() > 50)
        before = port.device.boot
        port.device.reboot()
        listener.until(lambda: listener.batches["d1"][-1].boot != before)
        listener.until(lambda: "reboots" in listener.infos["d1"].events)
        after = port.device.boot
    boots = [batch.boot for batch in listener.batches["d1"]]
    assert sorted(set(boots), key=boots.index) == [before, after]
    first = next(batch for batch in listener.batches["d1"] if batch.boot == after)
    assert (first.sequence, int(first.flags[0])) == (0, 0)
    old, new = (f"{ALIVE}device/d1/{keys.boot_id(boot or 0)}" for boot in (before, after))
    listener.until(lambda: (new, True) in listener.alive)
    assert [one for one in listener.alive if one[0] in (old, new)][:3] == [(old, True), (old, False), (new, True)]


def test_an_unplugged_device_comes_back_with_its_gap_in_sight(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with published(tmp_path, broker) as port:
        listener.until(lambda: listener.count() > 50)
        lost = bytearray()

        def lose(data: bytes) -> bytes:
            lost.extend(data)
            return b""

        port.byte_fault = lose
        listener.until(lambda: len(lost) > 1000)  # some samples
        port.unplug()
        port.byte_fault = None
        listener.until(lambda: ("/device/" in listener.alive[-1][0], listener.alive[-1][1]) == (True, False))
        here = len(listener.batches["d1"])
        port.plug()
        listener.until(lambda: len(listener.batches["d1"]) > here + 3)
        listener.until(lambda: listener.infos["d1"].events.keys() >= {"reconnections", "missing_samples"})
    assert listener.infos["d1"].events["reconnections"] == 1
    after_gap = [int(batch.flags[0]) & SampleFlag.AFTER_GAP for batch in listener.batches["d1"]]
    assert sum(after_gap) == 1
    assert len({batch.boot for batch in listener.batches["d1"]}) == 1


def test_a_device_that_cannot_be_opened_is_told_of_with_its_trouble(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with PtyPort(demo_device("d1", 1), tmp_path / "d1") as port:
        port.unplug()
        config = Bridge(id="b1", batch_ms=20, devices=(native(port),))
        with MemoryBus(broker) as bus, Pump("w", config, bus):
            listener.until(lambda: any(Code.PORT_MISSING in codes(info.trouble) for info in listener.infos.values()))
            info = listener.infos["d1"]
            assert (info.boot, info.bridge, info.driver, info.port) == (0, "b1", "native", str(port.link))
            listener.until(lambda: bool(listener.alive))
            assert [key for key, _ in listener.alive] == [f"{ALIVE}bridge/b1"]
            port.plug()
            listener.until(lambda: listener.count() > 50)
            listener.until(lambda: not listener.infos["d1"].trouble)
            assert listener.infos["d1"].boot == port.device.boot
            port.unplug()
            listener.until(lambda: bool(listener.infos["d1"].trouble))
            assert listener.infos["d1"].boot == port.device.boot


def test_a_router_that_goes_away_costs_nothing_within_the_cache(
    tmp_path: Path, broker: MemoryBroker, listener: Listener
) -> None:
    with published(tmp_path, broker):
        listener.until(lambda: listener.count() > 50)
        broker.stop()
        time.sleep(0.3)
        broker.start()
        here = listener.count()
        listener.until(lambda: listener.count() > here + 50)
    assert unbroken(listener.batches["d1"])


def test_a_replay_is_published_to_its_last_sample(tmp_path: Path, broker: MemoryBroker, listener: Listener) -> None:
    gyro = np.random.default_rng(0).normal(size=(1000, 3)).astype(np.float32)
    np.savez(tmp_path / "r.npz", gyro_rad_s=gyro, rate_hz=100.0)
    device = Device("d1", "replayed", ReplayedOptions(file=str(tmp_path / "r.npz"), speed=50))
    with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", devices=(device,)), bus) as ward:
        listener.until(lambda: ward.over)
    listener.until(lambda: listener.count() == 1000)
    assert np.array_equal(np.concatenate([batch.gyro for batch in listener.batches["d1"]]), gyro)
    listener.until(lambda: listener.infos["d1"].samples == 1000)  # its last account comes behind its last sample
    assert listener.infos["d1"].boot_cause is BootCause.PORT_OPENED


def status_of(device: str, boot: int, state: State) -> bytes:
    three = (0.0, 0.0, 0.0)
    return codec.encode_status(
        Status(device, boot, 1, state, Quality.NONE, (), 0.0, (), three, three, three, "", 0, 0.0, 20.0, 0.0, 0, 0)
    )


def test_a_bridge_whose_device_is_refused_says_so_once(
    broker: MemoryBroker, listener: Listener, caplog: pytest.LogCaptureFixture
) -> None:
    words = english(Code.TWO_BRIDGES(devices="d1", owner="b0", refused="b1"))
    status = codec.decode_status(keys.build("w", "status", device="d1"), status_of("d1", 1, State.TRACKING))
    config = Bridge(id="b1", batch_ms=20, devices=(Device("d1", "simulated", SimulatedOptions()),))
    with MemoryBus(broker) as estimator, MemoryBus(broker) as bus, Pump("w", config, bus) as ward:
        for device in ("d2", "d1", "d1"):
            said = replace(status, device=device, bridge="b0", refused_bridges=("b1",))
            estimator.publisher(keys.build("w", "status", device=device), cache=1).put(codec.encode_status(said))
        listener.until(lambda: words in caplog.text)
        assert ward.refused == {"d1"}
        said = replace(status, bridge="b1", refused_bridges=())
        estimator.publisher(keys.build("w", "status", device="d1"), cache=1).put(codec.encode_status(said))
        listener.until(lambda: not ward.refused)
    assert caplog.text.count("are refused") == 1


def test_a_device_of_which_nothing_can_be_taken_stops_no_other(
    broker: MemoryBroker, listener: Listener, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    take = DeviceThread.take

    def fails(link: DeviceThread, *, informed: bool) -> Taken:
        if link.device == "d1":
            raise ValueError("no")
        return take(link, informed=informed)

    monkeypatch.setattr(DeviceThread, "take", fails)
    config = Bridge(
        id="b1", batch_ms=20, devices=tuple(Device(id_, "simulated", SimulatedOptions()) for id_ in ("d1", "d2"))
    )
    with MemoryBus(broker) as bus, Pump("w", config, bus):
        listener.until(lambda: listener.count("d2") > 100)
    assert "d1: publishing failed" in caplog.text
