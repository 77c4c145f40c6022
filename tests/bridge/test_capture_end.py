"""The end of a capture: what a decoder still held comes out, and one that nothing was understood of ends with words."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest

from bridge.config import Device
from bridge.drivers.driver import DeviceLost, Event, Readings
from bridge.drivers.stream import StreamDriver
from bridge.drivers.witmotion import UNSETTLED
from bridge.framing import ximu3_encode
from bridge.ingest.device_thread import DeviceThread
from bridge.ingest.intake import Intake
from tests.bridge.mtdata2_device import item, message, reals
from tests.bridge.test_mavlink_driver import Sender
from tests.bridge.witmotion_device import motion, time

#: fewer than a rate is measured by, so that all of them are held
FEW = 20
STEP_S = 0.01


def ximu3() -> bytes:
    times = 1_000_000 + np.arange(FEW) * round(STEP_S * 1e6)
    return b"".join(ximu3_encode.inertial(times, np.ones((FEW, 3)), np.ones((FEW, 3))))


def mavlink(samples: int = FEW) -> bytes:
    sender = Sender()
    return b"".join(sender.highres(1_000_000 + round(n * STEP_S * 1e6)) for n in range(samples))


def printed() -> bytes:
    """The first line after an opening is never taken: it may be the end of one."""
    return b"".join(f"{1000 + round(n * STEP_S * 1e3)},1,2,3,4,5,6\r\n".encode() for n in range(FEW + 1))


def mtdata2() -> bytes:
    return b"".join(
        message(0x36, item(0x1060, (n * 100).to_bytes(4)) + reals(0x8020, (0.1, 0.2, 0.3))) for n in range(FEW)
    )


def witmotion() -> bytes:
    begin = datetime(2026, 3, 1)  # noqa: DTZ001 - the device knows of no zone
    return b"".join(
        time(begin + timedelta(seconds=n * STEP_S)) + motion(0x51, (0, 0, 2048), 2512) + motion(0x52, (n, 3, 4))
        for n in range(FEW)
    )


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


def opened(path: Path, driver: str, **more: object) -> StreamDriver:
    port = f"file://{quote(str(path))}?bytes_per_s=1e5"
    made = Device.from_table({"id": "wrist", "driver": driver, "port": port, **more}).make()
    assert isinstance(made, StreamDriver)
    return made


def to_the_end(driver: StreamDriver) -> list[Event]:
    driver.open()
    events: list[Event] = []
    while True:
        try:
            events += driver.read(0.01)
        except DeviceLost:
            driver.close()
            return events


@pytest.mark.parametrize(
    ("driver", "capture", "more"),
    [
        ("ximu3", ximu3, {}),
        ("mavlink", mavlink, {}),
        ("mtdata2", mtdata2, {}),
        ("witmotion", witmotion, {"keep_settings": True}),
        ("text_profile", printed, {"profile": "p.toml"}),
    ],
)
def test_what_is_held_comes_out_at_the_end_of_a_capture(
    tmp_path: Path, driver: str, capture: Callable[[], bytes], more: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.toml").write_text(PROFILE)
    (tmp_path / "a.bin").write_bytes(capture())
    played = opened(tmp_path / "a.bin", driver, **more)
    samples = sum(len(event.ticks) for event in to_the_end(played) if isinstance(event, Readings))
    unsettled = played.faults.as_dict().get(UNSETTLED, 0)
    assert samples == played.samples_in
    assert samples + unsettled == FEW
    assert unsettled < FEW / 2


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
    (record,) = [record for record in caplog.records if "is over" in record.message]
    assert record.levelname == "WARNING"
    for words in (str(path), "in 20000 bytes there was no sample of driver ximu3", "truerate bridge scan --port"):
        assert words in record.message


def test_a_capture_of_another_device_says_which(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "other.bin"
    path.write_bytes(mavlink(200))
    ended(opened(path, "ximu3"), "ximu3")
    assert "They look like driver = 'mavlink'" in caplog.text


def test_an_empty_capture_says_so_and_a_good_one_ends_quietly(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "bridge.ingest.device_thread")
    path = tmp_path / "a.bin"
    path.write_bytes(b"")
    ended(opened(path, "ximu3"), "ximu3")
    assert "there was nothing in it" in caplog.text
    caplog.clear()
    path.write_bytes(ximu3())
    ended(opened(path, "ximu3"), "ximu3")
    assert "is over" in caplog.text
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
