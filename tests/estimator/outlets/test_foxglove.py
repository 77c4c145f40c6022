"""`truerate outlet foxglove`: what a client of Foxglove's protocol receives of a ward."""

import json
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bridge.bus.contract import Reply
from bridge.ros import messages
from bridge.toml.loader import ConfigError
from bridge.wire import codec, keys
from bridge.wire.messages import CommandReply, Note
from estimator.cli.main import main
from estimator.client import Client
from estimator.outlets.foxglove.server import FoxgloveOutlet
from tests.bridge.recording.crowd import WARD, Crowd, corrected, samples
from tests.bridge.recording.test_per_sample import orientation
from tests.estimator.outlets.foxglove_client import FoxgloveClient, Received
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import free

LAYOUT = Path(__file__).parents[3] / "configs" / "foxglove-layout.json"


@contextmanager
def served(broker: MemoryBroker, *, recalibrate: bool = False) -> Iterator[int]:
    """An outlet on a bus in memory; its port."""
    stop = threading.Event()
    client = Client(ward=WARD, bus=MemoryBus(broker))
    with FoxgloveOutlet(client, None, "127.0.0.1", 0, recalibrate=recalibrate) as outlet:

        def run() -> None:
            while not stop.is_set():
                outlet.round(0.05)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield outlet.port
        finally:
            stop.set()
            thread.join()


def received(client: FoxgloveClient, enough: Callable[[list[Received]], bool]) -> list[Received]:
    """What comes until it is enough."""
    found = list[Received]()
    while not enough(found):
        if (one := client.receive(0.1)) is not None:
            found.append(one)
    return found


def test_a_client_receives_every_sample_once() -> None:
    broker = MemoryBroker()
    with MemoryBus(broker) as bus, Crowd(bus, 3, 0.02) as crowd, served(broker) as port, FoxgloveClient(port) as client:
        most = {f"/{WARD}/{name}/imu": 60 for name in crowd.names} | {"/tf": 1, f"/{WARD}/{crowd.names[0]}/status": 1}
        found = received(client, lambda found: not Counter(most) - Counter(one.topic for one in found))
    assert [client.channels[f"/{WARD}/{name}/imu"]["schemaName"] for name in crowd.names] == [messages.IMU] * 3
    for name in crowd.names:
        times = np.array([one.time_ns for one in found if one.topic == f"/{WARD}/{name}/imu"])
        assert (np.diff(times) == 9_615_000).all()
    status = json.loads(next(one.payload for one in found if one.topic.endswith("/status")))
    assert (status["state"], status["quality"], status["reason"]) == ("TRACKING", "GOOD", "tracking")


def test_a_device_has_its_rates_orientation_place_and_log() -> None:
    broker, at_ns = MemoryBroker(), time.time_ns()
    with MemoryBus(broker) as bus, served(broker) as port, FoxgloveClient(port) as client:

        def put(what: str, payload: bytes, **ids: str) -> None:
            bus.publisher(keys.build(WARD, what, device="chest", **ids)).put(payload)

        sequence, seen, imus = -10, list[Received](), list[Received]()
        while len(imus) < 10 or not {"/log", "/tf"} <= {one.topic for one in seen}:  # until the client has subscribed
            sequence += 10
            of = samples("chest", sequence, 10, at_ns + sequence * 9_615_000)
            put("raw", codec.encode_samples(of), bridge="bridge-1")
            put("corrected", codec.encode_corrected(corrected(of)))
            put("orientation", codec.encode_orientation(orientation("chest", sequence, 10, of.start_time_ns)))
            put("note", codec.encode_note(Note("chest", 7, at_ns, "anna", "sat up")))
            seen += [one for one in (client.receive(0.02) for _ in range(30)) if one is not None]
            last_ns = of.sample_time_ns.tolist()
            imus = [one for one in seen if one.topic.endswith("/chest/imu") and one.time_ns in last_ns]
    assert [one.time_ns for one in imus] == last_ns
    imu = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(imus[-1].payload, messages.IMU)
    rate, accel, turned = imu.angular_velocity, imu.linear_acceleration, imu.orientation  # type: ignore[attr-defined]
    assert [rate.x, rate.y, rate.z] == (2 * of.gyro[-1]).tolist()
    assert of.accel is not None
    assert [accel.x, accel.y, accel.z] == of.accel[-1].tolist()
    angle = np.radians(sequence + 9)
    assert [turned.w, turned.z] == pytest.approx([np.cos(angle / 2), np.sin(angle / 2)])
    frame = next(one for one in reversed(seen) if one.topic == "/tf")
    assert b"chest" in frame.payload
    assert WARD.encode() in frame.payload
    assert any(one.topic == "/log" and b"anna: sat up" in one.payload for one in seen)


def test_the_service_asks_for_a_calibration_only_where_it_is_allowed() -> None:
    broker, asked = MemoryBroker(), list[str]()

    def obey(key: str, payload: bytes, reply: Reply) -> None:
        command = codec.decode_command(key, payload)
        asked.append(f"{key.rsplit('/', 2)[1]} {command.who}: {command.reason}")
        reply(codec.encode_reply(CommandReply(command.request_id, accepted=True, message=free("waiting for turns"))))

    with MemoryBus(broker) as bus:
        bus.answer(keys.pattern(WARD, "rpc"), obey)
        with served(broker) as port, FoxgloveClient(port) as client:
            received(client, lambda _: bool(client.channels))
            assert client.services == {}
        with served(broker, recalibrate=True) as port, FoxgloveClient(port) as client:
            received(client, lambda _: bool(client.services))
            answer = client.call("/recalibrate", {"device": "chest", "reason": "strap moved"})
            assert answer == {"accepted": True, "message": "waiting for turns"}
            assert not client.call("/recalibrate", {"device": "*"})["accepted"]
            assert not client.call("/recalibrate", {})["accepted"]
    assert asked == ["chest foxglove: strap moved"]


def test_what_is_wrong_is_said_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    client = Client(ward=WARD, bus=MemoryBus(MemoryBroker()))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"cannot listen on 127.0.0.1:{port}: .*in use.*; choose another"):
            FoxgloveOutlet(client, None, "127.0.0.1", port)
    command = ["outlet", "foxglove", "--ward", "w", "--connect", "tcp/127.0.0.1:1"]
    assert main([*command, "--host", "0.0.0.0", "--allow-recalibrate"]) == 2
    assert "everybody who reaches the port could recalibrate" in capsys.readouterr().err
    assert main([*command, "--port", "99999"]) == 2
    assert "--port is 99999: use 1 to 65535" in capsys.readouterr().err


def test_the_layout_plots_what_the_outlet_sends() -> None:
    layout = LAYOUT.read_text(encoding="utf-8")
    panels = json.loads(layout)["configById"]
    assert {name.split("!")[0] for name in panels} >= {"Plot", "3D", "RosOut", "CallService"}
    assert "/demo/chest/imu.angular_velocity.x" in layout
