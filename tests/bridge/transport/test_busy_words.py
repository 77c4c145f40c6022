"""Who has a port open, in words: the ward's bridge, one program, or several."""

import pytest

from bridge.transport import serial_state
from bridge.transport.holders import Holder

ONE, TWO = Holder(7, "python"), Holder(8, "minicom")


@pytest.mark.parametrize(
    ("having", "bridges", "words"),
    [
        ([ONE], {7}, "busy; a bridge (process 7) reads it"),
        ([TWO], {7}, "busy; minicom (process 8) has it open: close that one"),
        ([ONE, TWO], {7}, "busy; python (process 7), minicom (process 8) have it open: close those"),
        ([], set(), "busy; another program has it open: close that one"),
    ],
)
def test_who_has_it_open(having: list[Holder], bridges: set[int], words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_state, "holders", lambda _: having)
    monkeypatch.setattr(serial_state, "is_bridge", lambda pid: pid in bridges)
    assert serial_state.busy("/dev/x") == words
