"""Checks of the machine and of the router."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from bridge.bus.contract import Bus, BusError
from bridge.diagnose import machine
from bridge.diagnose.finding import Level
from bridge.diagnose.router import router
from tests.bridge.diagnose.test_port_access import only
from tests.memory_bus import MemoryBroker, MemoryBus


def test_a_clock_is_kept_right_by_another_or_not() -> None:
    assert only(machine.clock(0x2001))[0] is Level.OK
    assert only(machine.clock(0x40))[0] is Level.WARNING
    assert only(machine.clock(None))[0] is Level.WARNING
    assert machine.clock_status() is not None


@pytest.mark.parametrize(("free", "level"), [(5e9, Level.OK), (5e8, Level.WARNING), (5e6, Level.TROUBLE)])
def test_a_disk_has_room_or_not(tmp_path: Path, free: float, level: Level) -> None:
    found, said, _ = only(machine.disk({"store": tmp_path / "not/yet/there"}, lambda _: int(free)))
    assert found is level
    assert said == f"{tmp_path}: {free / 1e9:.1f} GB free"


def test_a_place_that_is_no_folder_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    level, said, do = only(machine.disk({"recordings": tmp_path / "file" / "x"}))
    assert (level, said) == (Level.TROUBLE, f"{tmp_path}/file is a file, not a folder")
    assert "choose another folder" in do
    assert only(machine.disk({"store": tmp_path}))[1].startswith(str(tmp_path))


def test_a_missing_folder_of_recordings_is_seen(tmp_path: Path) -> None:
    level, _, do = only(machine.recordings(tmp_path / "a" / "b"))
    assert (level, do) == (Level.WARNING, f"mkdir -p {tmp_path}/a/b")
    assert machine.recordings(tmp_path) == machine.recordings(Path("recordings")) == []


def test_a_router_is_reached_or_not() -> None:
    def nobody(_: Sequence[str]) -> Bus:
        raise BusError("no router answered")

    assert only(router(["tcp/h:1"], nobody))[0] is Level.TROUBLE
    assert only(router(["tcp/h:1"], lambda _: MemoryBus(MemoryBroker())))[:2] == (Level.OK, "answers at tcp/h:1")


def test_of_two_routers_the_one_that_is_away_is_named() -> None:
    def one_of_two(endpoints: Sequence[str]) -> Bus:
        if "tcp/h:2" in endpoints:
            raise BusError("no router answered at tcp/h:2")
        return MemoryBus(MemoryBroker())

    found = router(["tcp/h:1", "tcp/h:2"], one_of_two)
    assert [(finding.level, finding.said) for finding in found] == [
        (Level.OK, "answers at tcp/h:1"),
        (Level.WARNING, "no router answered at tcp/h:2"),
    ]
