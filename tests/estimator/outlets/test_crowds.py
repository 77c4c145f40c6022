"""Outlets in a ward of invented devices, foreign bridges, huge rates and clocks of the far future."""

import gc
import threading
import time
import weakref
from dataclasses import replace

import pytest

import tests.lsl  # noqa: F401 - before anything of LSL
from bridge.ros import messages
from bridge.ros.imu_rows import ImuJoin, reading_rows
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo
from estimator.client import Client
from estimator.outlets.lsl import service
from estimator.outlets.places import SILENT_S, Places
from tests.bridge.recording.crowd import RATE_HZ, WARD, corrected, info, samples, status
from tests.lsl import inlet
from tests.memory_bus import MemoryBroker, MemoryBus

FAR_NS = 2**62  # the last time that the wire takes, in 2116


def test_those_heard_first_keep_their_place_until_they_fall_silent() -> None:
    left = list[str]()
    places = Places(left.append, most=2)
    assert [places.take(name, 0.0) for name in ("a", "b", "c", "a")] == [True, True, False, True]
    assert places.take("a", SILENT_S)
    assert not places.take("c", SILENT_S), "b may still come"
    assert places.take("c", SILENT_S + 2.0)
    assert left == ["b"]
    assert not places.take("b", SILENT_S + 2.0)


def test_lsl_streams_are_few_and_of_the_bridge_that_hears_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "_STREAMS", 3)
    broker, stop = MemoryBroker(), threading.Event()
    bus = MemoryBus(broker)

    def hear(device: str, *infos: DeviceInfo) -> None:
        now_ns = time.time_ns()
        for one in infos:
            key = keys.build(WARD, "info", bridge=one.bridge, device=device)
            bus.publisher(key, cache=1).put(codec.encode_info(one))
        said = replace(status(device, now_ns), bridge="bridge-1")
        bus.publisher(keys.build(WARD, "status", device=device), cache=1).put(codec.encode_status(said))
        batch = corrected(samples(device, 0, 10, now_ns))
        bus.publisher(keys.build(WARD, "corrected", device=device), cache=5).put(codec.encode_corrected(batch))

    named = {name: info(name, 1) for name in ("chest", "wrist")}
    foreign = replace(named["chest"], bridge="ghost", rate_hz=1e6)
    hear("chest", named["chest"], foreign)
    hear("wrist", replace(named["wrist"], rate_hz=1e6))  # memory of 300 MB at once
    outlet = service.LslOutlet(Client(ward=WARD, bus=MemoryBus(broker)), None, ())
    running = threading.Thread(target=outlet.run, args=(stop,))
    running.start()
    try:
        until = time.monotonic() + 30
        while len(outlet._streams) < 2:
            assert time.monotonic() < until
            for number in range(5):
                hear(f"ghost-{number}", info(f"ghost-{number}", 1))
            for name, one in named.items():
                hear(name, one if name == "chest" else replace(one, rate_hz=1e6))
            time.sleep(0.2)
        rates = {name: inlet(f"truerate/{WARD}/{name}/rates").info().nominal_srate() for name in named}
        assert rates == {"chest": RATE_HZ, "wrist": 0.0}
        assert len(outlet._streams) <= 3
    finally:
        stop.set()
        running.join()


def test_the_far_future_is_shown_as_the_last_time_that_ros_has() -> None:
    rows = reading_rows(samples("chest", 0, 1, FAR_NS))
    ((time_ns, payload),) = messages.ImuEncoder("chest").encode(rows)
    assert time_ns == FAR_NS
    assert int.from_bytes(payload[4:8], "little", signed=True) == 2**31 - 1
    assert messages.encode_transforms([messages.Transform(FAR_NS, "w", "chest", (0, 0, 0), (1, 0, 0, 0))])


def test_readings_of_invented_devices_are_not_kept() -> None:
    join, kept = ImuJoin(), list["weakref.ref[object]"]()
    for number in range(100):
        batch = samples(f"ghost-{number}", 0, 10, 10**18)
        batch = replace(batch, gyro=batch.gyro.copy())
        kept.append(weakref.ref(batch.gyro))
        assert join.take(batch, 0.0) == []
    del batch
    assert join.due(1.0) == []
    assert join.due(10.0) == []
    gc.collect()
    assert not any(one() is not None for one in kept)
