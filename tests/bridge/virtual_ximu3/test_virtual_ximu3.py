"""Virtual x-IMU3s: read by x-io's own connection, and by our own driver."""

import contextlib
import json
import socket
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import ximu3

from bridge.framing.ximu3 import Inertial, decode
from bridge.virtual_ximu3.device import VirtualXimu3
from bridge.virtual_ximu3.ports import ANNOUNCED_AT, REPLY_PORT, Address
from bridge.virtual_ximu3.show import Show, Wanted
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, CorrectedBatch, DeviceInfo, Quality, SampleBatch
from estimator.cli.main import main
from tests.bridge.drivers import xio
from tests.memory_bus import MemoryBroker, MemoryBus

N, HZ = 10, 100.0
BIAS = np.float32(0.25)
pytestmark = pytest.mark.xdist_group("virtual-ximu3")  # one port of announcements a machine


def raw(first: int, boot: int = 1, device: str = "chest", n: int = N) -> SampleBatch:
    number = np.arange(first, first + n)
    columns = np.asarray(np.column_stack([number, number + 1, number + 2]) % 500 / 100, np.float32)
    return SampleBatch(
        device=device,
        boot=boot,
        sequence=first,
        receive_time_ns=10**18,
        start_time_ns=10**18 + first * 10_000_000,
        tick_period_s=1e-6,
        clock_rate=1.0,
        ticks=(5_000_000 + number * 10_000).astype(np.uint64),
        gyro=columns,
        accel=columns + np.float32(9),
        temperature_c=np.full(n, 31.5, np.float32),
        flags=np.zeros(n, np.uint32),
    )


def corrected(of: SampleBatch, quality: Quality = Quality.GOOD) -> CorrectedBatch:
    three = np.ones(3, np.float32) * np.float32(0.01)
    return CorrectedBatch(
        device=of.device,
        boot=of.boot,
        sequence=of.sequence,
        start_time_ns=of.start_time_ns,
        tick_period_s=of.tick_period_s,
        clock_rate=of.clock_rate,
        ticks=of.ticks,
        rate=of.gyro - BIAS,
        flags=of.flags,
        quality=quality,
        noise_std=three,
        bias_std=three,
        scale_std=three,
        bias=three,
        calibration="c1",
        cross_std=three,
    )


def info(device: str = "chest", bridge: str = "b1") -> DeviceInfo:
    return DeviceInfo(
        device=device,
        bridge=bridge,
        boot=1,
        boot_cause=BootCause.POWER_UP,
        model="model",
        firmware="2.1",
        driver="native",
        port="p",
        rate_hz=HZ,
        measured_rate_hz=HZ,
        gyro_range=4.0,
        has_accel=True,
        has_temperature=True,
        time_ns=1,
        battery_percent=62.0,
        charging=True,
    )


def numbers(messages: list[bytes]) -> list[Inertial]:
    decoded = [decode_line(message) for message in messages]
    return [message for message in decoded if isinstance(message, Inertial)]


def decode_line(message: bytes) -> object:
    assert message.endswith(b"\n")
    assert message.count(b"\n") == 1
    return decode(message[:-1])


def test_corrected_rates_go_with_the_accelerations_of_their_samples() -> None:
    device = VirtualXimu3("w", "chest", corrected=True)
    for first in (0, 10, 20):
        assert numbers(device.took_raw(raw(first))) == []
    sent = numbers(device.took_corrected(corrected(raw(5, n=20))))
    expected = raw(5, n=20)
    assert [m.time_us for m in sent] == (expected.ticks).tolist()
    assert np.allclose(np.radians([m.gyro_dps for m in sent]), expected.gyro - BIAS, atol=1e-6)
    assert expected.accel is not None
    assert np.allclose(np.array([m.accel_g for m in sent]) * 9.80665, expected.accel, rtol=1e-5)
    unknown = numbers(device.took_corrected(corrected(raw(100))))
    assert np.all(np.array([m.accel_g for m in unknown]) == 0)
    other_boot = numbers(device.took_corrected(corrected(raw(0, boot=2))))
    assert np.all(np.array([m.accel_g for m in other_boot]) == 0)


def test_what_an_estimator_repeats_is_left_out() -> None:
    device = VirtualXimu3("w", "chest", corrected=True)
    batches = raw(0), raw(10), raw(0), raw(15), raw(0, boot=2)
    assert [len(numbers(device.took_corrected(corrected(batch)))) for batch in batches] == [10, 10, 0, 5, 10]


def test_settings_are_read_only_and_noise_is_not_answered() -> None:
    device = VirtualXimu3("w", "chest", corrected=True)
    device.took_info(info())

    def asked(command: object) -> object:
        return json.loads(device.answer(json.dumps(command).encode()))

    assert asked({"Serial Number": None}) == {"Serial Number": device.serial}
    assert asked({"inertial_message_rate_divisor": None}) == {"inertial_message_rate_divisor": 4}
    assert asked({"device_name": "x"}) == {"device_name": {"error": "Read-only"}}
    assert asked({"erase": None}) == {"erase": {"error": "Unknown command"}}
    assert VirtualXimu3("w", "wrist", corrected=True).serial != device.serial
    for noise in (b"", b"{", b"[]", b"{}", b'{"a":1,"b":2}', b'{"\xff":1}', b'{"a":' * 500):
        assert device.answer(noise) == b""


class Ward:
    """A bus with a device that is published, and its show, in a thread."""

    def __init__(self, wanted: Wanted) -> None:
        self.broker = MemoryBroker()
        self.bus = MemoryBus(self.broker)
        self.show = Show(MemoryBus(self.broker), wanted)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            self.show.turn()
        self.show.close()

    def publish(self, batch: SampleBatch, bridge: str = "b1") -> None:
        raw_key = keys.build("w", "raw", bridge=bridge, device=batch.device)
        corrected_key = keys.build("w", "corrected", device=batch.device)
        self.bus.publisher(raw_key).put(codec.encode_samples(batch))
        self.bus.publisher(corrected_key).put(codec.encode_corrected(corrected(batch)))

    def introduce(self, device: str = "chest", bridge: str = "b1") -> None:
        key = keys.build("w", "info", bridge=bridge, device=device)
        self.bus.publisher(key, cache=1).put(codec.encode_info(info(device, bridge)))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.bus.close()


@pytest.fixture
def ward() -> Iterator[Callable[[Wanted], Ward]]:
    with contextlib.ExitStack() as stack:

        def opened(wanted: Wanted) -> Ward:
            made = Ward(wanted)
            stack.callback(made.close)
            return made

        yield opened


def free_address(n: int = 1) -> Address:
    """The first of n free ports in a row that have free ports for commands."""
    rng = np.random.default_rng()
    while True:
        first = int(rng.integers(20_000, 50_000))
        with contextlib.ExitStack() as stack:
            try:
                for port in (first + i + more for i in range(n) for more in (0, REPLY_PORT)):
                    stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(("127.0.0.1", port))
            except OSError:
                continue
            return Address("127.0.0.1", first)


@contextlib.contextmanager
def opened(config: ximu3.ConnectionConfig) -> Iterator[tuple[ximu3.Connection, xio.Heard]]:
    connection = ximu3.Connection(config)
    heard = xio.listen(connection)
    connection.open()
    try:
        yield connection, heard
    finally:
        connection.close()


def expected(first: int, n: int) -> list[xio.Row]:
    batch = raw(first, n=n)
    assert batch.accel is not None
    columns = np.hstack([np.degrees(batch.gyro - BIAS), batch.accel / 9.80665]).astype(np.float32)
    return [(int(t), tuple(map(float, row))) for t, row in zip(batch.ticks, columns, strict=True)]


def test_x_io_s_connection_receives_every_sample_and_gets_answers(ward: Callable[[Wanted], Ward]) -> None:
    at = free_address()
    running = ward(Wanted("w", at, devices=("chest",)))
    with opened(ximu3.UdpConnectionConfig(at.host, at.port + REPLY_PORT, at.port)) as (connection, heard):
        response = connection.ping()
        assert response is not None
        assert (response.device_name, response.interface) == ("chest", "UDP")
        running.introduce()
        for first in range(0, 500, N):
            running.publish(raw(first))
        xio.until(lambda: len(heard.inertial) == 500)
        assert heard.inertial == expected(0, 500)
        assert heard.errors == []
        assert heard.texts[0][1] == "quality good"
        xio.until(lambda: bool(heard.temperature and heard.battery))
        assert heard.temperature[0][1] == (31.5,)
        assert heard.battery[0][1] == (62.0, 0.0, 1.0)
        answer = connection.send_command('{"firmware_version":null}')
        assert answer is not None
        assert json.loads(answer.value) == "model 2.1"


def test_a_device_has_a_port_of_its_own_and_is_announced(ward: Callable[[Wanted], Ward]) -> None:
    try:
        announced = ximu3.NetworkAnnouncement()
    except RuntimeError:
        pytest.skip(f"another program listens for announcements, UDP {ANNOUNCED_AT}")
    at = free_address(2)
    running = ward(Wanted("w", at, announce=Address("127.0.0.1", ANNOUNCED_AT)))
    running.introduce("chest")
    running.publish(raw(0))
    running.publish(raw(0, device="wrist"))
    names = {"chest", "wrist"}
    xio.until(lambda: {m.device_name for m in announced.get_messages()} >= names)
    ours = sorted((m for m in announced.get_messages() if m.device_name in names), key=lambda m: m.udp_send)
    assert [(m.udp_send, m.udp_receive) for m in ours] == [(at.port + i, at.port + i + REPLY_PORT) for i in range(2)]
    for message in ours:
        config = message.to_udp_connection_config()
        assert config is not None
        with opened(config) as (connection, _):
            response = connection.ping()
            assert response is not None
            assert (response.device_name, response.serial_number) == (message.device_name, message.serial_number)


def test_one_bridge_a_device_and_no_strangers() -> None:
    broker = MemoryBroker()
    with MemoryBus(broker) as bus, MemoryBus(broker) as other:
        shown = Show(bus, Wanted("w", free_address(2), corrected=False))
        try:
            put_raw(other, raw(0), "b1")
            put_raw(other, raw(0), "b2")
            other.publisher(keys.build("w", "raw", bridge="b1", device="wrist")).put(b"nonsense")
            for _ in range(3):
                shown.turn()
            assert shown.refused.as_dict() == {"of a second bridge": 1, "malformed": 1}
        finally:
            shown.close()


def put_raw(bus: MemoryBus, batch: SampleBatch, bridge: str) -> None:
    bus.publisher(keys.build("w", "raw", bridge=bridge, device=batch.device)).put(codec.encode_samples(batch))


@pytest.mark.parametrize("wrong", ["8000x", "127.0.0.1:0", ":70000", "65535"])
def test_wrong_addresses_are_refused_in_words(wrong: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bridge", "ximu3", "--udp", wrong]) == 2
    assert "127.0.0.1:8000" in capsys.readouterr().err
