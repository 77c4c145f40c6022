"""Who has a port open, in words: the ward's bridge, one program, or several."""

import pytest

from bridge.reasons.codes import Code, Sentence
from bridge.transport import serial_errors
from bridge.transport.port_holders import Holder

ONE, TWO = Holder(7, "python"), Holder(8, "minicom")


@pytest.mark.parametrize(
    ("having", "bridges", "said"),
    [
        ([ONE], {7}, Code.PORT_READ_BY_BRIDGE(place="/dev/x", holders="python (process 7)")),
        ([TWO], {7}, Code.PORT_HELD(place="/dev/x", holders="minicom (process 8)")),
        ([ONE, TWO], {7}, Code.PORT_HELD(place="/dev/x", holders="python (process 7), minicom (process 8)")),
        ([], set(), Code.PORT_BUSY(place="/dev/x")),
    ],
)
def test_who_has_it_open(
    having: list[Holder], bridges: set[int], said: Sentence, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_errors, "holders", lambda _: having)
    monkeypatch.setattr(serial_errors, "is_bridge", lambda pid: pid in bridges)
    assert serial_errors.busy("/dev/x") == said
