"""What `truerate devices` says: every value under its heading, and all of it in 80 columns."""

import io
import threading
from dataclasses import replace

import pytest
from rich.console import Console, RenderableType

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.reasons.codes import Code
from bridge.wire.messages import BootCause, DeviceInfo, State
from estimator import screen, watch
from estimator.client import Client
from estimator.glance import glance
from tests.estimator.client.test_revision import revision
from tests.estimator.test_ward_view import status
from tests.sentences import free
from tests.web.talk import WARD, Talk, said
from tests.web.test_views import corrected

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
    headings = [column.heading for column in watch._HARDWARE]
    return dict(zip(headings, watch._hardware_row(info), strict=True))


def test_every_heading_has_its_value() -> None:
    row = hardware(INFO)
    assert row["device"] == "wrist-right-01"
    assert row["what it is"] == "truerate-virtual 1.0"
    assert row["bridge"] == "bridge-1"
    assert row["Hz"] == "103.9 of 104"
    assert row["samples"] == "123456"
    assert row["not published or in trouble"] == "3 not finite"


def test_it_fits_80_columns_with_whole_names() -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(watch._hardware({INFO.device: INFO}))
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    assert "wrist-right-01" in shown
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= 80


LONG = replace(INFO, device="wrist-right-of-bed-17-ward-three", bridge="bridge-in-the-corridor-west-two")
STATUS = replace(status("wrist-right-01", State.AWAITING_STILL), rate_hz=104.0)
BUSY = replace(STATUS, dropped={"duplicate": 987654321, "old_boot": 12345678}, refused_bridges=("b2",), bridge="b1")


@pytest.mark.parametrize("width", [80, 60])
def test_what_does_not_fit_is_folded_or_left_out_and_no_number_is_cut(width: int) -> None:
    seen = glance("w", {INFO.device: BUSY}, {INFO.device: INFO, LONG.device: LONG}, ["b1", "b2"], ["e"])
    for table in (
        watch._hardware({INFO.device: INFO, LONG.device: LONG}),
        screen.table({INFO.device: BUSY}),
        watch._glance(seen),
        watch._panel(INFO.device, None, BUSY),
    ):
        shown = printed(table, width)
        assert "…" not in shown
        assert max(map(len, shown.splitlines())) <= width
    assert "123456" in printed(watch._hardware({LONG.device: LONG}), width)
    assert {"987654321", "12345678"} <= set(printed(watch._glance(seen), width).split())
    assert "103.9 of 104" in printed(watch._hardware({INFO.device: INFO}), width)


def test_a_rest_is_said_only_where_there_was_one() -> None:
    assert "no rest known yet" in printed(watch._panel("a", None, STATUS), 80)
    assert "last rest 12 s ago" in printed(watch._panel("a", None, replace(STATUS, evidence_age_s=12.0)), 80)


def printed(table: RenderableType, width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_device_that_cannot_be_opened_is_shown_with_its_trouble() -> None:
    row = hardware(replace(INFO, boot=0, trouble=free("the port is missing")))
    assert row["what it is"] == "not heard yet"
    assert row["not published or in trouble"] == "the port is missing"


def test_a_revision_says_how_far_back_and_why() -> None:
    said = watch._revision_line(revision(reason=(Code.AT_REST_AGAIN(gap_s=95),)))
    assert (
        said == "the bias of 2 s is known better now, to ± 28.0749 °/s (95 %): The device is at rest again after 95 s."
    )


def test_what_comes_now_and_then_stays_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    broker = MemoryBroker()
    talk, client = Talk(broker), Client(ward=WARD, bus=MemoryBus(broker))
    monkeypatch.setattr(watch, "Client", lambda *_, **__: client)
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    talk(said("a"))
    threading.Timer(0.3, talk, (corrected("a", 0.5),)).start()
    assert watch.watch(console, WARD, (), "a", 1.2) == 0
    talk.close()
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().rfind("nan") < console.file.getvalue().index("+28.65")


def test_a_device_that_is_lost_is_said_to_be_lost_and_why() -> None:
    lost = replace(status("a", State.LOST), reason=free("its port is missing"))
    assert watch._unheard("a", "w", lost) == "no sample of a came in ward w: it is lost: its port is missing"
    assert watch._unheard("a", "w", None).startswith("nothing was heard of a")
