"""What `truerate devices` says: every value under its heading, and all of it in 80 columns."""

import io
from dataclasses import replace

from rich.console import Console

from bridge.wire.messages import BootCause, DeviceInfo
from estimator import watch
from tests.estimator.test_revision import revision

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


def test_every_heading_has_its_value() -> None:
    row = dict(zip(watch._HARDWARE, watch._hardware_row(INFO), strict=True))
    assert row["device"] == "wrist-right-01"
    assert row["what it is"] == "truerate-virtual 1.0"
    assert row["bridge"] == "bridge-1"
    assert row["Hz"] == "103.9 of 104"
    assert row["samples"] == "123456"
    assert row["not published or in trouble"] == "3 non_finite"


def test_it_fits_80_columns_with_whole_names() -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(watch._hardware({INFO.device: INFO}))
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    assert "wrist-right-01" in shown
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_a_device_that_cannot_be_opened_is_shown_with_its_trouble() -> None:
    row = dict(
        zip(watch._HARDWARE, watch._hardware_row(replace(INFO, boot=0, trouble="the port is missing")), strict=True)
    )
    assert row["what it is"] == "not heard yet"
    assert row["not published or in trouble"] == "the port is missing"


def test_a_revision_says_how_far_back_and_why() -> None:
    said = watch._revision_line(revision(reason="at rest again after 95 s"))
    assert said == "the bias of 2 s is known better now, to 14.3239 °/s: at rest again after 95 s"
