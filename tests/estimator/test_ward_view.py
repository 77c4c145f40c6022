"""What a person should know of a ward: everything of every device, those that need somebody first, in the room there is."""

import io
import json
import math
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

from bridge.bus.contract import Publisher
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.reasons.catalogue import sentences_as_json
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import DeviceInfo, Quality, State, Status
from estimator import listening, watch, watch_ward
from estimator.client import Client, Corrected
from estimator.session import DeviceSession
from estimator.ward_view import SILENT_S, WardView, age, chosen, head_line
from tests.estimator.stream import info
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
        "lost", "unheard", "awaiting_still", "empty", "bias_only", "degraded", "turning", "warming", "noticed", "charging", "ok",
    ]  # fmt: skip


def test_the_head_line_counts_them() -> None:
    assert head_line(MANY.rows(10.0)) == (
        "4 of 11 tracking; 1 lost, 1 unknown, 1 awaiting still, 1 bias only, 1 degraded, 1 turning, 1 warming"
    )
    assert head_line(view(status("a"), status("b")).rows(10.0)) == "2 of 2 tracking"


def test_a_row_has_all_that_is_known() -> None:
    [row] = view(
        status("a", rate_hz=103.9, evidence_age_s=65.0, events={"gaps": 2, "missing_samples": 31}),
        about("a", battery_percent=80.0, notices=free("blinks")),
    ).rows(10.0)
    reason, notices = sentences_as_json(free("all is well")), sentences_as_json(free("blinks"))
    assert row.as_dict() == {
        "device": "a", "state": "tracking", "reason": reason, "quality": "good", "rate_hz": 103.9, "gaps": 2,
        "missing_samples": 31, "evidence_age_s": 65.0, "battery_percent": 80.0, "charging": False, "notices": notices,
    }  # fmt: skip
    [bare] = view(status("a", evidence_age_s=1e12), about("a", battery_percent=math.nan)).rows(10.0)
    assert (bare.evidence_age_s, bare.battery_percent) == (None, None)
    rest = watch_ward.HEADINGS.index("rest")
    [unheard] = view(about("a")).rows(10.0)
    assert [watch_ward._cells(one)[rest] for one in (row, bare, unheard)] == ["65 s", "none", ""]


def test_a_device_of_which_no_word_comes_is_not_what_it_was() -> None:
    seen = view(status("a"))
    assert [row.state for row in seen.rows(10.0 + SILENT_S)] == ["tracking"]
    [row] = seen.rows(25.0)
    assert row.state == "silent"
    assert row.reason == (Code.SILENT_ESTIMATOR(duration_s="15"),)


def test_what_keeps_a_device_from_being_read_is_said() -> None:
    [row] = view(status("a", State.LOST), about("a", trouble=free("the port is missing"))).rows(10.0)
    assert row.reason == (*free("the port is missing"), *free("all is well"))
    [row] = view(about("a")).rows(10.0)
    assert (row.state, row.reason) == ("unknown", (Code.NO_ESTIMATOR_SPOKE(),))


def test_of_several_bridges_that_list_a_device_the_one_that_hears_it_has_the_last_word() -> None:
    seen = view(
        about("a", bridge="deaf", boot=0, trouble=free("no")),
        about("a", bridge="hears"),
        about("a", bridge="deaf", boot=0, trouble=free("no")),
    )
    assert Code.NO_ESTIMATOR_SPOKE in codes(seen.rows(0.0)[0].reason)


@pytest.mark.parametrize(
    ("only", "found"),
    [
        ((), 11),
        (("degraded",), 1),
        (("awaiting-still", "LOST"), 2),
        (("awaiting_still",), 1),
        (("*ed",), 2),
        (("ok", "ok", "nobody"), 1),
    ],
)
def test_some_of_them(only: tuple[str, ...], found: int) -> None:
    assert len(chosen(MANY.rows(10.0), only)) == found


@pytest.mark.parametrize("width", [60, 80, 120, 200])
@pytest.mark.parametrize("height", [3, 8, 24])
def test_it_fits_a_terminal_and_says_what_does_not(width: int, height: int) -> None:
    rows = MANY.rows(10.0)
    shown = [line.plain for line in watch_ward.lines(rows, "head", width, height)]
    assert len(shown) <= height
    assert max(map(cell_len, shown)) <= width
    assert shown[2].startswith("lost") or height == 3
    if height < len(rows) + 2:
        assert shown[-1].startswith(f"… and {len(rows) - (height - 3)} more: ")
    else:
        assert shown[-1].startswith("ok")


@pytest.mark.parametrize("width", [20, 40, 60])
def test_a_column_without_room_is_left_out_whole(width: int) -> None:
    rows = view(status("a" * 32, rate_hz=104.0), about("a" * 32, battery_percent=87.0)).rows(10.0)
    _, headings, line = (shown.plain for shown in watch_ward.lines(rows, "head", width))
    assert ("battery" in headings) == ("87 %" in line)
    assert "…" not in headings or width < 48


def test_once_nothing_is_cut() -> None:
    rows = view(status("wrist", reason=free("no samples for " + "1" * 80))).rows(10.0)
    assert "1" * 80 in watch_ward.lines(rows, "head", 60, cut=False)[2].plain


def test_of_two_bridges_the_one_whose_samples_are_taken_has_the_word() -> None:
    seen = view(
        status("a", bridge="b1", refused_bridges=("b2",)),
        about("a", bridge="b1", battery_percent=50.0),
        about("a", bridge="b2", battery_percent=70.0),
    )
    (row,) = seen.rows(10.0)
    assert row.battery_percent == 50.0
    assert Code.TWO_BRIDGES in codes(row.notices)


def test_where_there_is_no_width_nothing_is_cut() -> None:
    rows = view(status("a" * 32, rate_hz=100.0, events={"gaps": 3}), about("a" * 32, notices=free("x" * 400))).rows(
        10.0
    )
    _, headings, line = watch_ward.lines(rows, "head")
    assert headings.plain.split() == ["device", "state", "quality", "Hz", "gaps", "rest", "why"]
    assert "x" * 400 in line.plain


def test_reasons_are_cut_last() -> None:
    rows = view(status("wrist-left", State.AWAITING_STILL, rate_hz=100.0)).rows(10.0)
    narrow, wide = (watch_ward.lines(rows, "head", width)[1].plain.split() for width in (60, 100))
    assert narrow == ["device", "state", "Hz", "why"] or "quality" not in narrow
    assert wide == ["device", "state", "quality", "Hz", "gaps", "rest", "why"]


@pytest.mark.parametrize(
    ("seconds", "said"), [(1.0, "1 s"), (119.0, "119 s"), (600.0, "10 min"), (10_000.0, "3 h"), (4e5, "5 d")]
)
def test_ages_are_short(seconds: float, said: str) -> None:
    assert age(seconds) == said


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
    for module in (listening, watch_ward, watch):
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
    statuses, infos = watch._said(client)
    assert speaking.now - began == pytest.approx(SILENT_S + 1.6 if hangs else 1.5), "no longer than it takes to know"
    assert (len(statuses), list(infos)) == (120, ["d5"])
    assert (statuses["d4"].state, statuses["d4"].reason) == (State.TRACKING, free("all is well"))
    assert (statuses["d3"].state is State.UNKNOWN) is hangs
    assert (statuses["d3"].quality is Quality.DEGRADED) is hangs
    assert (Code.SILENT_ESTIMATOR in codes(statuses["d3"].reason)) is hangs
    assert watch_ward.watch_ward(console, client, once=True) == 0
    assert ("1 silent" in file.getvalue()) is hangs


def test_one_device_that_is_watched_is_not_what_it_was_either(
    speaking: Speaking, monkeypatch: pytest.MonkeyPatch
) -> None:
    speaking.say(status("d0"))
    speaking.hang("d0")
    bus, (console, file) = speaking.bus, terminal()
    monkeypatch.setattr(watch, "Client", lambda *_, ward: Client(ward=ward, bus=bus))
    monkeypatch.setattr(Corrected, "receive", lambda *_: speaking.sleep(0.2))
    assert watch.watch(console, WARD, (), "d0", 5.0) == 1
    assert "it is unknown: No word of the device has come for 5 s" in file.getvalue()


@pytest.mark.usefixtures("client")
def test_who_is_heard_is_said_where_the_one_that_is_watched_is_not(
    speaking: Speaking, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus, (console, file) = speaking.bus, terminal()
    monkeypatch.setattr(watch, "Client", lambda *_, ward: Client(ward=ward, bus=bus))
    monkeypatch.setattr(Corrected, "receive", lambda *_: speaking.sleep(0.2))
    assert watch.watch(console, WARD, (), "d1x", 5.0) == 1
    waiting, names, unheard = file.getvalue().splitlines()
    assert waiting == "waiting for d1x …"
    assert names.startswith("heard in ward w: d0, d1, d10, ")
    assert names.endswith(" and 100 more")
    assert "nothing was heard of d1x" in unheard


@pytest.mark.parametrize(("after_s", "early"), [(0.4, True), (5.0, False)])
def test_who_interrupts_before_anything_can_be_known_is_told_nothing(
    speaking: Speaking, client: Client, monkeypatch: pytest.MonkeyPatch, after_s: float, *, early: bool
) -> None:
    def interrupt(*_: object) -> None:
        speaking.sleep(after_s)
        raise KeyboardInterrupt

    bus, (console, file) = speaking.bus, terminal()
    monkeypatch.setattr(watch, "Client", lambda *_, ward: Client(ward=ward, bus=bus))
    monkeypatch.setattr(Corrected, "receive", interrupt)
    monkeypatch.setattr(listening.Ears, "listen", interrupt)
    with pytest.raises(KeyboardInterrupt) if early else nullcontext():
        assert watch.watch(console, WARD, (), "d0", None) == 1
    with pytest.raises(KeyboardInterrupt) if early else nullcontext():
        assert watch_ward.watch_ward(console, client) == 1
    assert ("nothing was heard of d0" in file.getvalue()) is not early


def test_once_as_json(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    console, _ = terminal()
    assert watch_ward.watch_ward(console, client, ["degraded"], once=True, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ward"], found["tracking"], found["of"]) == (WARD, 119, 120)
    [device] = found["devices"]
    assert (device["device"], device["state"], device["battery_percent"]) == ("d77", "degraded", None)


def test_live_it_has_the_height_of_the_terminal(client: Client) -> None:
    console, file = terminal(force_terminal=True, legacy_windows=False)
    assert watch_ward.watch_ward(console, client, seconds=0.0) == 0
    shown = file.getvalue()
    assert "w: 119 of 120 tracking; 1 degraded" in shown
    assert "… and 93 more: 93 tracking" in shown
    assert "d77" in shown


def test_where_there_is_no_terminal_changes_are_lines(client: Client) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, client, ["d77", "d5"], seconds=0.05) == 0
    assert sorted(file.getvalue().splitlines()) == ["d5: tracking: all is well", "d77: degraded: all is well"]


def test_nobody_there(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, Client(ward="other", bus=MemoryBus(MemoryBroker())), once=True) == 1
    assert "no device is heard" in capsys.readouterr().err
    assert watch_ward.watch_ward(console, client, ["lost"], once=True) == 0
    assert "none is lost" in file.getvalue()


def test_a_word_that_is_nobody_and_no_state_is_said(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    console, file = terminal()
    assert watch_ward.watch_ward(console, client, ["degarded"], once=True) == 1
    assert "no device that is heard, and no state, is degarded; states are" in file.getvalue()
    assert "; heard are d0, d1, d10, " in file.getvalue()
    assert " and 100 more\n" in file.getvalue()
    assert watch_ward.watch_ward(console, client, ["degarded", "d77"], once=True, as_json=True) == 1
    printed = capsys.readouterr()
    assert [device["device"] for device in json.loads(printed.out.splitlines()[-1])["devices"]] == ["d77"]
    assert "is degarded" in printed.err
    assert watch_ward.watch_ward(console, client, ["lost", "awaiting-still", "d*"], once=True) == 0
