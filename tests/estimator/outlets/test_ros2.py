"""`truerate outlet ros2`: what a subscriber of rmw_zenoh receives of a ward, through a real router."""

import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.ros import messages, rmw_zenoh
from bridge.wire import keys
from estimator.cli.main import main
from estimator.client import Client
from estimator.demo.ward import free_port
from estimator.outlets.ros2.node import Ros2Outlet
from tests.bridge.pki.guarded_ward import WARD as GUARDED
from tests.bridge.pki.guarded_ward import GuardedWard
from tests.bridge.recording.crowd import WARD, Crowd

STORE = get_typestore(Stores.ROS2_JAZZY)
pytestmark = pytest.mark.xdist_group("zenoh")


@contextmanager
def published(endpoint: str) -> Iterator[Ros2Outlet]:
    """An outlet that runs, in domain 7."""
    stop = threading.Event()
    with Client([endpoint], ward=WARD) as client, ZenohBus([endpoint]) as bus:
        outlet = Ros2Outlet(client, None, bus, 7)

        def run() -> None:
            while not stop.is_set():
                outlet.round(0.05)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield outlet
        finally:
            stop.set()
            thread.join()


def session(endpoint: str) -> zenoh.Session:
    """A session as rmw_zenoh has one: a client of the router, by zenoh itself."""
    config = zenoh.Config.from_json5(
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    )
    return zenoh.open(config)


def wait(until: Any, timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not until():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.02)


def test_a_node_of_rmw_zenoh_finds_the_topics_and_receives_every_sample_once() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    tokens, heard = list[str](), list[tuple[str, bytes, bytes]]()

    def take(sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        heard.append((str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes()))

    with (
        Router([endpoint]),
        ZenohBus([endpoint]) as bus,
        Crowd(bus, 2, 0.02) as crowd,
        published(endpoint) as outlet,
        session(endpoint) as ros,
    ):
        graph = ros.liveliness().declare_subscriber(
            "@ros2_lv/7/**", lambda one: tokens.append(str(one.key_expr)), history=True
        )
        wait(lambda: len(tokens) == 5)  # the node, /tf, /diagnostics and two devices
        topics = [one.split("/") for one in tokens if "/MP/" in one]
        subscriptions = [
            ros.declare_subscriber(f"7/{parts[9].strip('%').replace('%', '/')}/{parts[10]}/{parts[11]}", take)
            for parts in topics
        ]
        wait(lambda: len({key for key, _, _ in heard}) == 4)
        heard.clear()
        wait(lambda: len(came := Counter(key for key, _, _ in heard)) == 4 and came.most_common(2)[1][1] > 60)
        del graph, subscriptions
    assert outlet.name == f"truerate_{WARD}"
    assert any(token.endswith(f"/NN/%/%/{outlet.name}") for token in tokens)
    imus = {name: f"%{WARD}%{name.replace('-', '_')}%imu" for name in crowd.names}
    assert {parts[9] for parts in topics} == {"%tf", "%diagnostics", *imus.values()}
    for name in crowd.names:
        key = rmw_zenoh.topic_key(7, f"/{WARD}/{name.replace('-', '_')}/imu", messages.IMU)
        mine = [(payload, beside) for of, payload, beside in heard if of == key]
        numbers, of_time, _, ids = zip(*(struct.unpack("<qqB16s", beside) for _, beside in mine), strict=True)
        assert (np.diff(numbers) == 1).all()
        assert len(mine) > 60
        assert abs(of_time[-1] - time.time_ns()) < 60_000_000_000
        assert set(ids) == {rmw_zenoh.gid(next(one for one in tokens if imus[name] in one))}
        stamps = [STORE.deserialize_cdr(payload, messages.IMU).header.stamp for payload, _ in mine]  # type: ignore[attr-defined]
        assert (np.diff([stamp.sec * 1_000_000_000 + stamp.nanosec for stamp in stamps]) == 9_615_000).all()
    poses = [payload for key, payload, _ in heard if key.startswith("7/tf/")]
    frames = {one.child_frame_id: one for one in STORE.deserialize_cdr(poses[-1], messages.TRANSFORMS).transforms}  # type: ignore[attr-defined]
    assert all(frame.header.frame_id == WARD for frame in frames.values())
    found = [payload for key, payload, _ in heard if key.startswith("7/diagnostics/")]
    assert {one.name for one in STORE.deserialize_cdr(found[-1], messages.DIAGNOSTICS).status} <= {  # type: ignore[attr-defined]
        f"{WARD}/{name}" for name in crowd.names
    }


def test_the_role_ros2_publishes_to_ros_2_and_nowhere_else(tmp_path: Path) -> None:
    ward = GuardedWard(tmp_path / "pki", ("ros2:outlet", "ros2:robot", "viewer:v1", "estimator:e1"))
    imu = rmw_zenoh.topic_key(0, f"/{GUARDED}/chest/imu", messages.IMU)
    corrected = keys.build(GUARDED, "corrected", device="chest")
    elsewhere = rmw_zenoh.topic_key(0, "/other/chest/imu", messages.IMU)
    alive = list[str]()
    with (
        ward.running(),
        ward.bus("ros2:outlet") as outlet,
        ward.bus("ros2:robot") as robot,
        ward.bus("viewer:v1") as viewer,
    ):
        subscriptions = {
            who: bus.subscribe([imu, elsewhere, corrected]) for who, bus in (("robot", robot), ("viewer", viewer))
        }
        watch = robot.watch_alive("@ros2_lv/0/**", lambda key, _: alive.append(key))
        token = outlet.declare_alive(rmw_zenoh.Node(0, outlet.session_id, "truerate_w").token)
        publishers = [outlet.publisher(key) for key in (elsewhere, corrected, imu)]
        heard = dict[str, set[str]]((who, set()) for who in subscriptions)

        def all_is_said() -> bool:
            for publisher in publishers:
                publisher.put(b"x", b"y")
            for who, subscription in subscriptions.items():
                heard[who] |= {one.key for one in subscription.drain(99, 0.1)}
            return bool(heard["robot"])

        wait(all_is_said)
        wait(all_is_said)  # whatever else the robot may hear was known to the router as soon as that
        wait(lambda: alive)
        watch.close()
        token.close()
    assert heard == {"robot": {imu}, "viewer": set()}


def test_what_is_wrong_is_said_in_one_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["outlet", "ros2", "--ward", WARD, "--connect", "tcp/127.0.0.1:1"]
    assert main(command) == 1
    assert "no router answered at tcp/127.0.0.1:1" in capsys.readouterr().err
    assert main([*command, "--domain", "500"]) == 2
    assert "ROS domain '500' is not valid: use 0 to 232" in capsys.readouterr().err
    assert main([*command, "--ros-router", "127.0.0.1"]) == 2
    assert "--ros-router: '127.0.0.1' is not an endpoint" in capsys.readouterr().err
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router([endpoint]):
        here = ["outlet", "ros2", "--ward", WARD, "--connect", endpoint]
        assert main([*here, "--device", "nobody"]) == 2
        assert f"no device nobody is heard in ward {WARD}" in capsys.readouterr().err
        assert main([*here, "--ros-router", "tcp/127.0.0.1:1"]) == 1
        assert "no router answered at tcp/127.0.0.1:1" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "xxhash", None)
    assert main(command) == 2
    assert "truerate outlet ros2 needs another package: pip install 'truerate[ros2]'" in capsys.readouterr().err
