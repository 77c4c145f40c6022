"""What `truerate devices` says: every value under its heading, and all of it in 80 columns."""

from dataclasses import replace

from bridge.wire.messages import BootCause, DeviceInfo
from estimator.terminal import watch_device
from tests.sentences import free

INFO = DeviceInfo(
    device="wrist-right-01",
    bridge="bridge-1",
    boot=1,
    boot_cause=BootCause.POWER_UP,
    model="truerate-virtual",
    firmware="1.0",
    driver="native",
    port="/dev/serial/by-id/x",
    rate_hz=104.0,
    measured_rate_hz=103.9,
    gyro_range=8.7,
    has_accel=True,
    has_temperature=True,
    time_ns=0,
    samples=123456,
    dropped={"non_finite": 3},
)


def hardware(info: DeviceInfo) -> dict[str, str]:
    headings = [column.heading for column in watch_device._HARDWARE]
    return dict(zip(headings, watch_device._hardware_row(info), strict=True))


def test_every_heading_has_its_value() -> None:
    row = hardware(INFO)
    assert row["device"] == "wrist-right-01"
    assert row["model"] == "truerate-virtual 1.0"
    assert row["bridge"] == "bridge-1"
    assert row["Hz"] == "103.9 of 104"
    assert row["samples"] == "123456"
    assert row["dropped samples or faults"] == "3 not finite"


def test_a_device_that_cannot_be_opened_is_shown_with_its_trouble() -> None:
    row = hardware(replace(INFO, boot=0, trouble=free("the port is missing")))
    assert row["model"] == "not heard yet"
    assert row["dropped samples or faults"] == "the port is missing"
