"""The Debian package names files that are there, and its services run commands that exist."""

import re
import shlex
import socket
from pathlib import Path

import pytest

from bridge.runtime.service_manager import supervised
from estimator.cli.main import build

ROOT = Path(__file__).parents[1]
PACKAGING = ROOT / "packaging"
UNITS = sorted((PACKAGING / "systemd").glob("*.service"))


def heard(manager: socket.socket) -> int:
    """Messages until a silence."""
    for n in range(1000):
        try:
            manager.recv(64)
        except TimeoutError:
            return n
    return 1000


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_service_runs_a_command_that_exists(unit: Path) -> None:
    words = shlex.split(re.findall(r"^ExecStart=(.*)$", unit.read_text(), re.MULTILINE)[0])
    assert words[0] == "/usr/bin/truerate"
    build().parse_args([word.replace("${ROUTER_CONFIG}", "/etc/truerate/ward.toml") for word in words[1:]])


def test_the_containers_run_commands_that_exist() -> None:
    commands = re.findall(
        r"^  (\w+):\n    <<: \*program\n    command: \[(.*)\]$", (PACKAGING / "compose.yaml").read_text(), re.MULTILINE
    )
    assert {f"truerate-{name}" for name, _ in commands} == {unit.stem for unit in UNITS} - {"truerate-backup"}
    for _, words in commands:
        build().parse_args(words.split(", "))


def test_the_package_names_files_that_are_there() -> None:
    text = (PACKAGING / "nfpm.yaml").read_text()
    named = re.findall(r"(?:src|postinstall|preremove|postremove): ((?:packaging|configs)/\S*)", text)
    assert len(named) >= 8
    assert all((ROOT / name).exists() for name in named)


def test_a_service_says_that_it_is_ready_and_alive_until_it_is_sick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(30)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "30000")
        sick = list[str]()
        with supervised(lambda: sick):
            assert manager.recv(64) == b"READY=1"
            assert manager.recv(64) == b"WATCHDOG=1"
            sick.append("the loop has not turned for 9 s")
            manager.settimeout(0.5)
            assert heard(manager) < 1000, "what was on its way, and then silence"
            manager.settimeout(30)
        assert manager.recv(64) == b"STOPPING=1"
