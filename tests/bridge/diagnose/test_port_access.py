"""Checks of ports against made-up machines: each says how it is, and what to do."""

import os
from pathlib import Path

import pytest

from bridge.diagnose import port_access
from bridge.diagnose.finding import Finding, Level
from bridge.diagnose.port_access import Me

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


@pytest.mark.parametrize(
    ("mode", "who", "level"),
    [
        (0o660, "nobody", Level.TROUBLE),
        (0o660, "group", Level.OK),
        (0o640, "group", Level.TROUBLE),
        (0o600, "owner", Level.OK),
        (0o066, "owner", Level.TROUBLE),
        (0o666, "nobody", Level.OK),
        (0o000, "root", Level.OK),
    ],
)
def test_who_may_open_a_port(tmp_path: Path, mode: int, who: str, level: Level) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    port.chmod(mode)
    mine = port.stat()
    uid, gid = mine.st_uid + 1, mine.st_gid + 1
    asking = {
        "nobody": Me(uid, frozenset({gid})),
        "group": Me(uid, frozenset({gid, mine.st_gid})),
        "owner": Me(mine.st_uid or 4711, frozenset({gid})),
        "root": Me(0, frozenset()),
    }[who]
    if who == "owner" and mine.st_uid == 0:
        os.chown(port, 4711, -1)
    found, said, do = only(port_access.permissions([str(port), str(tmp_path / "gone")], asking))
    assert found is level
    if level is Level.TROUBLE:
        assert str(port) in said
        assert do.startswith("sudo usermod -aG ")
        assert "log out and in again" in do


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


def test_a_port_is_for_one_bridge(tmp_path: Path) -> None:
    proc, port, name = tmp_path / "proc", tmp_path / "ttyUSB0", tmp_path / "by-id"
    port.touch()
    name.symlink_to(port)
    run = "/venv/bin/python /venv/bin/truerate bridge run ward.toml"
    process(proc, 5, "truerate", port, command=run)
    process(proc, 6, "bash", command=f"bash -c {run}")
    assert only(port_access.busy([str(name)], proc))[:2] == (Level.OK, "no port is open in another program")
    process(proc, 8, "truerate", port, command=run)
    level, said, do = only(port_access.busy([str(name)], proc))
    assert (level, do) == (Level.TROUBLE, "stop all but one: kill 8")
    assert "truerate (process 5), truerate (process 8) have it open, so each gets only part of the bytes" in said
    process(proc, 9, "minicom", port)
    level, said, do = only(port_access.busy([str(name)], proc))
    assert (level, said) == (Level.TROUBLE, f"{name}: minicom (process 9) has it open")


def test_one_port_under_two_names_is_seen(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    (tmp_path / "by-id").symlink_to(port)
    (tmp_path / "by-path").symlink_to(port)
    devices = {"a": f"{tmp_path}/by-id", "b": "tcp://h:1", "c": f"{tmp_path}/by-path"}
    level, said, _ = only(port_access.doubled(devices))
    assert (level, said) == (Level.TROUBLE, f"a and c are both on {port}")
    assert only(port_access.doubled({"a": str(port), "b": "tcp://h:1"}))[0] is Level.OK
    assert only(port_access.doubled({}))[0] is Level.OK


def test_a_device_that_is_not_plugged_in_is_told(tmp_path: Path) -> None:
    master, terminal = os.openpty()
    assert port_access.present({"a": "tcp://h:1", "b": os.ttyname(terminal)}) == []
    os.close(master)
    os.close(terminal)
    level, said, _ = only(port_access.present({"a": "/dev/null"}))
    assert (level, said) == (Level.TROUBLE, "/dev/null is not a serial port")
    level, said, do = only(port_access.present({"a": str(tmp_path / "gone")}))
    assert (level, said) == (Level.WARNING, f"{tmp_path}/gone does not exist")
    assert "truerate bridge scan" in do


def test_the_rules_are_of_the_form_udev_takes() -> None:
    import re

    item = re.compile(r'[A-Z]+(\{[A-Za-z_]+\})?(==|!=|=|\+=)"[^"]*"')
    lines = [line for line in RULES.read_text().splitlines() if line and not line.startswith("#")]
    assert len(lines) == 4
    for line in lines:
        assert all(item.fullmatch(part) for part in line.split(", ")), line
    assert all(word in RULES.read_text() for word in ("-hupcl", "ID_MM_DEVICE_IGNORE", "latency_timer", "dialout"))
