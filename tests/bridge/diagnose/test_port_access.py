"""Checks of ports against made-up machines: each says how it is, and what to do."""

from pathlib import Path

import pytest

from bridge.diagnose import port_access
from bridge.diagnose.finding import Finding, Level
from bridge.reasons.codes import Code, Sentence

RULES = Path(__file__).parents[3] / "configs/udev/99-truerate.rules"


def only(findings: list[Finding]) -> tuple[Level, str, str]:
    (finding,) = findings
    assert bool(finding.do) == (finding.level is not Level.OK)
    return finding.level, finding.said, finding.do


def process(proc: Path, pid: int, name: str, *files: Path, command: str = "") -> None:
    fds = proc / str(pid) / "fd"
    fds.mkdir(parents=True)
    (proc / str(pid) / "comm").write_text(f"{name}\n")
    (proc / str(pid) / "cmdline").write_text((command or name).replace(" ", "\0") + "\0")
    for number, file in enumerate(files):
        (fds / str(number)).symlink_to(file)


def test_modem_manager_is_fine_only_with_a_rule(tmp_path: Path) -> None:
    rules, proc = tmp_path / "rules.d", tmp_path / "proc"
    rules.mkdir()
    process(proc, 3, "bash")
    assert only(port_access.modem_manager(proc, [rules]))[:2] == (Level.OK, "does not run")
    process(proc, 7, "ModemManager")
    (rules / "50-other.rules").write_text("# nothing")
    level, said, do = only(port_access.modem_manager(proc, [rules, tmp_path / "gone"]))
    assert level is Level.WARNING
    assert "to every device that is plugged in" in said
    assert str(port_access.RULES) in do
    (rules / RULES.name).write_text(RULES.read_text())
    assert only(port_access.modem_manager(proc, [rules]))[0] is Level.OK


@pytest.mark.parametrize(
    ("code", "level"),
    [
        (Code.PORT_MISSING(place="/dev/x"), Level.WARNING),
        (Code.PORT_FORBIDDEN(place="/dev/x"), Level.TROUBLE),
        (Code.PORT_HELD(place="/dev/x", holders="minicom (process 9)"), Level.TROUBLE),
        (Code.NOT_A_SERIAL_PORT(place="/dev/x"), Level.TROUBLE),
        (Code.PORT_READ_BY_BRIDGE(place="/dev/x", holders="truerate (process 5)"), Level.OK),
        (None, Level.OK),
    ],
)
def test_a_port_that_cannot_be_opened_is_told_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch, code: Sentence | None, level: Level
) -> None:
    monkeypatch.setattr("bridge.transport.serial_errors.fault", lambda _: code)
    assert only(port_access.usable(["/dev/x"]))[0] is level


def test_the_rules_are_of_the_form_udev_takes() -> None:
    import re

    item = re.compile(r'[A-Z]+(\{[A-Za-z_]+\})?(==|!=|=|\+=)"[^"]*"')
    lines = [line for line in RULES.read_text().splitlines() if line and not line.startswith("#")]
    assert len(lines) == 4
    for line in lines:
        assert all(item.fullmatch(part) for part in line.split(", ")), line
    assert all(word in RULES.read_text() for word in ("-hupcl", "ID_MM_DEVICE_IGNORE", "latency_timer", "dialout"))
