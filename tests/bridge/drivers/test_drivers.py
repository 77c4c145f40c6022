"""Every driver of a device that sends bytes, back to back: any chunking, lost messages, garbage, the end of a capture.

Sample number i tells its number by its rate about x, so that whatever comes out can be judged.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import pairwise
from math import radians
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.config.schema import Device
from bridge.drivers import registry
from bridge.drivers.byte_stream import StreamDriver
from bridge.drivers.driver import Event, Identity, Readings
from bridge.framing.cobs_frames import frame
from bridge.framing.packets import Data, Hello, encode_data, encode_hello
from bridge.ingest.device_thread import DeviceThread
from bridge.ingest.intake import Intake
from bridge.toml.loader import options
from bridge.transport.errors import DeviceLost
from tests.bridge.drivers import dot_device, mtdata2_device, shimmer3_device, witmotion_device
from tests.bridge.drivers.test_mavlink import Sender
from tests.bridge.framing import ximu3_encode

NOW_NS, STEP_NS = 10**18, 10_000_000
BEGIN = datetime(2026, 3, 1)  # noqa: DTZ001 - the device knows of no zone
UNSETTLED = 2  # samples that a driver may need before it knows whether the device tells time
PROFILE = """summary = "a test"
[device]
model = "m"
[csv]
columns = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
[time]
column = "t"
unit = "ms"
[gyro]
columns = ["gx", "gy", "gz"]
unit = "dps"
[accel]
columns = ["ax", "ay", "az"]
unit = "g"
"""


@dataclass(frozen=True)
class Protocol:
    """message(i): the bytes of sample i. unit: rad/s about x for each number. head: what comes before the samples."""

    message: Callable[[int], bytes]
    unit: float = 1e-3
    head: bytes = b""
    options: dict[str, Any] = field(default_factory=dict)


def native(i: int) -> bytes:
    gyro, ones = np.array([[i * 1e-3, 0, 0]], np.float32), np.ones((1, 3), np.float32)
    return frame(encode_data(Data(1, i, np.array([10_000 * i], np.uint32), gyro, ones, ones[:, 0])))


def ximu3(i: int) -> bytes:
    return ximu3_encode.inertial(np.array([1_000_000 + 10_000 * i]), np.array([[i * 1e-3, 0, 0]]), np.ones((1, 3)))[0]


def witmotion(i: int) -> bytes:
    time = witmotion_device.time(BEGIN + timedelta(seconds=0.01 * i))
    return time + witmotion_device.motion(0x51, (0, 0, 2048), 2512) + witmotion_device.motion(0x52, (i, 3, 4))


def mtdata2(i: int) -> bytes:
    items = mtdata2_device.item(0x1060, (100 * i).to_bytes(4)) + mtdata2_device.reals(0x8020, (i * 1e-3, 0.2, 0.3))
    return mtdata2_device.message(0x36, items)


def mavlink(i: int) -> bytes:
    return Sender().highres(1_000_000 + 10_000 * i, (i * 1e-3, -0.2, 0.3))


def movella_dot(i: int) -> bytes:
    return dot_device.value(dot_device.MEDIUM, dot_device.rates(1_000_000 + 10_000 * i, (0.1 * i, 1.0, -2.0)))


def shimmer3(i: int) -> bytes:
    return shimmer3_device.summed(shimmer3_device.packet(1000 + 320 * i, (0, i, 7)))


def text(i: int) -> bytes:
    return f"{1000 + 10 * i},{i / 100:.2f},2,3,4,5,6\r\n".encode()


SHIMMER3_HEAD = b"".join(
    map(
        shimmer3_device.summed,
        (b"\xff", b"\xff\x4a\x01", shimmer3_device.calibrations(shimmer3_device.EVEN), shimmer3_device.inquiry()),
    )
)
PROTOCOLS = {
    "native": Protocol(native, head=frame(encode_hello(Hello(1, 1e-6, 100.0, 4.0, True, True, "m", "f")))),
    "ximu3": Protocol(ximu3),
    "witmotion": Protocol(witmotion, radians(2000) / 32768, options={"keep_settings": True}),
    "mtdata2": Protocol(mtdata2),
    "mavlink": Protocol(mavlink),
    "movella_dot": Protocol(movella_dot, radians(0.1)),
    "shimmer3": Protocol(shimmer3, radians(-1 / 100), SHIMMER3_HEAD),
    "text_profile": Protocol(text, radians(0.01), b"\n", {"profile": "p.toml"}),
}
UNCHECKED = ("ximu3", "text_profile")  # a damaged number that is still a number is not seen
every_driver = pytest.mark.parametrize("name", PROTOCOLS)


@pytest.fixture(autouse=True, scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterable[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("profile"))
        Path("p.toml").write_text(PROFILE)
        yield


def fed(name: str, chunks: Sequence[tuple[bytes, int]]) -> tuple[list[Event], dict[str, int]]:
    """All events of some chunks, each with its time of arrival, and of the end of the stream; and the faults."""
    kind = registry.kinds()[name]
    assert kind.decoder is not None
    decoder = kind.decoder(options({"port": "file:///x", **PROTOCOLS[name].options}, kind.options))
    events = [event for data, at_ns in chunks for event in decoder.feed(data, at_ns)]
    return events + decoder.finish(), decoder.faults.as_dict()


def numbers(name: str, events: list[Event]) -> tuple[list[int], list[int]]:
    """The numbers that the samples tell by their rates, and those that the driver gave them."""
    readings = [event for event in events if isinstance(event, Readings)]
    told = [round(x / PROTOCOLS[name].unit) for one in readings for x in one.gyro[:, 0].tolist()]
    return told, [n for one in readings for n in range(one.sequence, one.sequence + len(one.ticks))]


@every_driver
@settings(max_examples=20)
@given(st.data())
def test_any_chunking_gives_the_same_readings(name: str, data: st.DataObject) -> None:
    protocol = PROTOCOLS[name]
    stream = protocol.head + b"".join(map(protocol.message, range(60)))
    cuts = data.draw(st.one_of(st.lists(st.integers(0, len(stream)), max_size=40), st.just(list(range(len(stream))))))
    pieces = [(stream[a:b], NOW_NS) for a, b in pairwise([0, *sorted(cuts), len(stream)])]
    (whole, faults), (parts, same_faults) = fed(name, [(stream, NOW_NS)]), fed(name, pieces)
    assert numbers(name, parts) == numbers(name, whole)
    assert same_faults == faults
    last, same = ([e for e in events if isinstance(e, Identity)][-1] for events in (whole, parts))
    assert (last.model, last.rate_hz) == (same.model, same.rate_hz)
    assert numbers(name, whole)[0] == list(range(60))[-len(numbers(name, whole)[0]) :]
    assert len(numbers(name, whole)[0]) >= 60 - UNSETTLED


@every_driver
@pytest.mark.parametrize("seed", range(2))
def test_of_lost_messages_each_is_missed_and_nothing_else(name: str, seed: int) -> None:
    protocol, rng = PROTOCOLS[name], np.random.default_rng(seed)
    kept = sorted({0, 1, 2, *np.flatnonzero(rng.random(600) > 0.2).tolist()})
    messages = [(protocol.message(i), NOW_NS + STEP_NS * i) for i in kept]
    events, _ = fed(name, [(protocol.head, NOW_NS), *messages])
    told, given_numbers = numbers(name, events)
    assert told == kept[-len(told) :]
    assert len(told) >= len(kept) - UNSETTLED
    np.testing.assert_array_equal(np.diff(given_numbers), np.diff(told))
    intake = Intake("d", "b", name, "p")
    published = [batch for event in events for batch in intake.take(event)]
    assert sum(map(len, published)) == len(told)
    assert intake.events.as_dict()["missing_samples"] == told[-1] - told[0] + 1 - len(told)


@every_driver
def test_garbage_and_flipped_bits_cost_few_messages_and_forge_none(name: str) -> None:
    protocol, rng = PROTOCOLS[name], np.random.default_rng(4)
    messages = [protocol.message(i) for i in range(400)]
    for at in range(10, 400, 40):
        messages[at] += rng.bytes(int(rng.integers(1, 60)))
    for at in range(30, 400, 20 if name not in UNCHECKED else 1000):
        bit = int(rng.integers(8 * len(messages[at])))
        whole = int.from_bytes(messages[at], "little") ^ 1 << bit
        messages[at] = whole.to_bytes(len(messages[at]), "little")
    events, faults = fed(name, [(protocol.head, NOW_NS), *((m, NOW_NS + STEP_NS * i) for i, m in enumerate(messages))])
    told, _ = numbers(name, events)
    assert told == sorted(set(told) & set(range(400)))
    assert len(told) >= 400 - 30 * 5
    others = np.concatenate([event.gyro[:, 1:] for event in events if isinstance(event, Readings)])
    assert (others == others[0]).all()
    assert faults


def opened(path: Path, driver: str, **more: object) -> StreamDriver:
    port = f"file://{quote(str(path))}?bytes_per_s=1e5"
    made = Device.from_table({"id": "wrist", "driver": driver, "port": port, **more}).make()
    assert isinstance(made, StreamDriver)
    return made


@every_driver
def test_what_is_held_comes_out_at_the_end_of_a_capture(name: str, tmp_path: Path) -> None:
    protocol, few = PROTOCOLS[name], 20  # fewer than a rate is measured by
    (tmp_path / "a.bin").write_bytes(protocol.head + b"".join(map(protocol.message, range(few))))
    played = opened(tmp_path / "a.bin", name, **protocol.options)
    played.open()
    events: list[Event] = []
    with suppress(DeviceLost):
        while True:
            events += played.read(0.01)
    played.close()
    samples = len(numbers(name, events)[0])
    assert few - UNSETTLED <= samples == played.samples_in


def ended(driver: StreamDriver, name: str) -> None:
    link = DeviceThread("wrist", driver, Intake("wrist", "b1", name, driver.place))
    link.start()
    link._thread.join(20.0)
    assert link.over
    link.stop()


def test_a_capture_of_garbage_ends_with_words(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "garbage.bin"
    path.write_bytes(np.random.default_rng(3).bytes(20_000))
    ended(opened(path, "ximu3"), "ximu3")
    (record,) = [record for record in caplog.records if "has 20000 bytes" in record.message]
    assert record.levelname == "WARNING"
    for words in (str(path), "has 20000 bytes, but no sample of driver ximu3", "truerate bridge scan --port"):
        assert words in record.message


def test_a_capture_of_another_device_says_which(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "other.bin"
    path.write_bytes(b"".join(map(mavlink, range(200))))
    ended(opened(path, "ximu3"), "ximu3")
    assert "The data looks like driver = 'mavlink'" in caplog.text


def test_an_empty_capture_says_so_and_a_good_one_ends_quietly(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "bridge.ingest.device_thread")
    path = tmp_path / "a.bin"
    path.write_bytes(b"")
    ended(opened(path, "ximu3"), "ximu3")
    assert "is empty" in caplog.text
    caplog.clear()
    path.write_bytes(b"".join(map(ximu3, range(20))))
    ended(opened(path, "ximu3"), "ximu3")
    assert "The capture file://" in caplog.text
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


@pytest.mark.parametrize(
    ("driver", "table", "words"),
    [
        ("ximu3", {"rate_hz": 500.0}, "rate_hz is 500: use 1 to 400"),
        ("witmotion", {"rate_hz": 104.0}, "rate_hz is 104: use one of 0.2"),
        ("witmotion", {"rate_hz": 50.0, "baud": 9600}, "set baud to 16500"),
        ("mtdata2", {"rate_hz": 2001}, "rate_hz is 2001: use 1 to 2000"),
        ("mtdata2", {"rate_hz": 400}, "set baud to 248000"),
        ("mtdata2", {"gyro_range_dps": -1.0}, "gyro_range_dps is -1"),
        ("mavlink", {"system": 256}, "system is 256: use 1 to 255"),
        ("native", {"rate_hz": -1.0}, "rate_hz is -1: use 0.1 to 100000"),
    ],
)
def test_options_that_cannot_work_are_refused_in_words(driver: str, table: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Device.from_table({"id": "d", "driver": driver, "port": "/dev/x", **table})
