"""What a person should know of a ward: everything of every device, those that need somebody first, in the room there is."""

import io
import json
from dataclasses import replace
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

from bridge.bus.contract import Publisher
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo, Quality, State, Status
from estimator.client import Client
from estimator.device.session import DeviceSession
from estimator.overview.ward import SILENT_S, WardView
from estimator.terminal import live_messages, watch_device, watch_ward
from tests.estimator.stream import info
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.sentences import codes, free

WARD = "w"


def status(device: str, state: State = State.TRACKING, **changes: Any) -> Status:
    plain = DeviceSession(device).status(7)
    return replace(plain, state=state, quality=Quality.GOOD, **{"reason": free("all is well"), **changes})


def about(device: str, **changes: Any) -> DeviceInfo:
    return replace(info(), device=device, **changes)


def view(*said: Status | DeviceInfo) -> WardView:
    made = WardView()
    for one in said:
        if isinstance(one, Status):
            made.take_status(one, 10.0)
        else:
            made.take_info(one)
    return made


MANY = view(
    status("ok"),
    status("empty"), about("empty", battery_percent=9.0),
    status("charging"), about("charging", battery_percent=9.0, charging=True),
    status("noticed"), about("noticed", notices=free("blinks red")),
    *(status(state.name.lower(), state) for state in State if state not in (State.TRACKING, State.UNKNOWN)),
    about("unheard", boot=0, trouble=free("the port is missing")),
)  # fmt: skip


def test_those_that_need_somebody_come_first() -> None:
    assert [row.device for row in MANY.rows(10.0)] == [
        "lost", "unheard", "empty", "awaiting_still", "bias_only", "degraded", "turning", "warming", "noticed", "charging", "ok",
    ]  # fmt: skip


@pytest.mark.parametrize("width", [60, 80, 120, 200])
@pytest.mark.parametrize("height", [3, 8, 24])
def test_it_fits_a_terminal_and_says_what_does_not(width: int, height: int) -> None:
    rows, file = MANY.rows(10.0), io.StringIO()
    Console(file=file, width=width, height=height).print(watch_ward.shown(rows, "head", width, height))
    shown = file.getvalue().splitlines()
    assert len(shown) <= height
    assert max(map(cell_len, shown)) <= width
    assert shown[2].startswith("lost") or height == 3
    if height < len(rows) + 2:
        assert shown[-1].startswith(f"… and {len(rows) - (height - 3)} more: ")
    else:
        assert shown[-1].startswith("ok")


class Speaking:
    """Time that passes only while somebody sleeps; meanwhile devices are spoken of, each once."""

    def __init__(self, broker: MemoryBroker) -> None:
        self.now, self.bus = 100.0, MemoryBus(broker)
        self._said: dict[str, tuple[Publisher, bytes]] = {}

    def say(self, *statuses: Status) -> None:
        """Now, and while time passes."""
        for one in statuses:
            publisher = self.bus.publisher(keys.build(WARD, "status", device=one.device), cache=1)
            self._said[one.device] = publisher, codec.encode_status(one)
            publisher.put(self._said[one.device][1])

    def hang(self, device: str) -> None:
        """What was said of it is remembered, and nothing more is said."""
        del self._said[device]

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        for publisher, payload in self._said.values():
            publisher.put(payload)


@pytest.fixture
def speaking(monkeypatch: pytest.MonkeyPatch) -> Speaking:
    made = Speaking(MemoryBroker())
    for module in (live_messages, watch_ward, watch_device):
        monkeypatch.setattr(module, "time", made)
    return made


@pytest.fixture
def client(speaking: Speaking) -> Client:
    bus = speaking.bus
    speaking.say(*(status(f"d{n}", State.DEGRADED if n == 77 else State.TRACKING) for n in range(120)))
    bus.publisher(keys.build(WARD, "info", bridge="bridge", device="d5"), cache=1).put(
        codec.encode_info(about("d5", battery_percent=3.0))
    )
    return Client(ward=WARD, bus=bus)


def terminal(**kind: Any) -> tuple[Console, io.StringIO]:
    file = io.StringIO()
    return Console(file=file, width=100, height=30, **kind), file


def test_once_it_is_all_there(client: Client) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, client, once=True) == 0
    head, headings, first, *_, last = file.getvalue().splitlines()
    assert head == "w: 119 of 120 tracking; 1 degraded"
    assert headings.split() == ["device", "state", "quality", "gaps", "rest", "battery", "why"]
    assert first.split()[0] == "d5"
    assert last.split()[0] == "d99"
    assert len(file.getvalue().splitlines()) == 122


@pytest.mark.parametrize("hangs", [False, True])
def test_of_whom_only_a_memory_is_left_it_is_said_at_once(speaking: Speaking, client: Client, *, hangs: bool) -> None:
    """An estimator whose loop hangs is alive on the bus, which goes on telling what was said last."""
    if hangs:
        speaking.hang("d3")
    began, (console, file) = speaking.now, terminal()
    statuses, infos = watch_device._said(client)
    assert speaking.now - began == pytest.approx(SILENT_S + 1.6 if hangs else 1.5), "no longer than it takes to know"
    assert (len(statuses), list(infos)) == (120, ["d5"])
    assert (statuses["d4"].state, statuses["d4"].reason) == (State.TRACKING, free("all is well"))
    assert (statuses["d3"].state is State.UNKNOWN) is hangs
    assert (statuses["d3"].quality is Quality.DEGRADED) is hangs
    assert (Code.SILENT_ESTIMATOR in codes(statuses["d3"].reason)) is hangs
    assert watch_ward.watch_ward(console, client, once=True) == 0
    assert ("1 silent" in file.getvalue()) is hangs


def test_once_as_json(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    console, _ = terminal()
    assert watch_ward.watch_ward(console, client, "d77", once=True, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ward"], found["tracking"], found["of"]) == (WARD, 119, 120)
    [device] = found["devices"]
    assert (device["device"], device["state"], device["battery_percent"]) == ("d77", "degraded", None)


def test_where_there_is_no_terminal_changes_are_lines(client: Client) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, client, "d77", seconds=0.05) == 0
    assert file.getvalue() == "d77: degraded: all is well\n"


def test_nobody_there(speaking: Speaking, capsys: pytest.CaptureFixture[str]) -> None:
    console, _ = terminal()
    assert watch_ward.watch_ward(console, Client(ward="other", bus=MemoryBus(MemoryBroker())), once=True) == 1
    assert "no device is heard" in capsys.readouterr().err


def test_a_device_that_is_not_heard_is_said(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, client, "nobody", once=True) == 1
    assert "; nobody is not heard; heard are d0, d1, d10, " in file.getvalue()
    assert " and 100 more\n" in file.getvalue()
    assert watch_ward.watch_ward(console, client, "nobody", once=True, as_json=True) == 1
    assert "nobody is not heard" in capsys.readouterr().err
