"""`truerate init`: what it writes is valid, a second run adds what is missing, and one ward file serves all programs."""

import io
import json
import os
import shlex
import socket
import ssl
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pytest

from bridge.bus.contract import BusError
from bridge.config.schema import Bus
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member, Role
from bridge.toml.loader import ConfigError, load
from estimator.cli.main import main
from estimator.client import Client
from estimator.config.schema import Ward
from estimator.demo.ward import free_port
from tests.bench.programs import program


class Installed:
    """An installation in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.data = folder / "etc", folder / "var"
        self.path = self.folder / "ward.toml"

    def __call__(self, *words: str, ward: str = "ward-3") -> int:
        places = ["--folder", str(self.folder), "--data", str(self.data)]
        return main(["init", ward, *places, "--no-scan", *words])

    def files(self) -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in self.folder.rglob("*") if path.is_file()}


@pytest.fixture
def init(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Installed:
    monkeypatch.setattr(sys, "stdin", io.StringIO())  # no terminal: passwords are made up
    monkeypatch.setenv("PATH", "")  # no systemctl
    return Installed(tmp_path)


def test_a_ward_on_one_machine_is_valid_and_a_dry_run_writes_nothing(
    init: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert init("--virtual", "2", "--dry-run") == 0
    assert not init.folder.exists()
    assert "would write" in capsys.readouterr().out
    assert init("--virtual", "2", "--person", "nurse", "--administrator", "chief") == 0
    said = capsys.readouterr()
    assert "password of nurse" in said.err
    assert "http://127.0.0.1:8090/" in said.out
    assert main(["config", "check", str(init.path)]) == 0
    ward = load(init.path, Ward)
    assert (ward.ward, len(ward.bridge.devices) if ward.bridge else 0) == ("ward-3", 2)
    people = init.data / "people.toml"
    assert Path(ward.dashboard.people_file) == people
    listed = load(people, Ward).dashboard.people
    assert {one.name: one.role for one in listed} == {"nurse": "operator", "chief": "administrator"}
    assert people.stat().st_mode & 0o777 == 0o600
    assert (init.data / "recordings").is_dir()
    assert init.path.stat().st_mode & 0o777 == 0o640


def test_a_folder_that_every_user_may_write_to_gets_no_keys(
    init: Installed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    elsewhere.chmod(0o777)
    init.folder.mkdir()
    (init.folder / "pki").symlink_to(elsewhere)
    assert init("--host", "localhost", "--virtual", "1") != 0
    assert "chmod o-w" in capsys.readouterr().err
    assert not list(elsewhere.iterdir())


def test_a_pipe_in_place_of_the_ward_file_is_refused(init: Installed, capsys: pytest.CaptureFixture[str]) -> None:
    init.folder.mkdir()
    os.mkfifo(init.path)
    assert init("--virtual", "1") != 0
    assert "a pipe or a device" in capsys.readouterr().err


def test_a_second_run_keeps_everything(init: Installed) -> None:
    init("--host", "localhost", "--bridge", "bridge-2", "--person", "nurse", "--virtual", "1")
    before = init.files()
    assert init() == 0
    assert init("--host", "localhost", "--bridge", "bridge-2", "--person", "nurse") == 0
    assert init.files() == before


def test_a_second_run_adds_virtual_devices_and_shows_the_files_own_page(
    init: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    init("--virtual", "1")
    assert f"truerate bridge run {init.path}" in capsys.readouterr().out, "no service reads a ward file elsewhere"
    init.path.write_text(init.path.read_text().replace(":8090", ":8190"))
    assert init("--virtual", "2") == 0
    said = capsys.readouterr().out
    assert "2 devices. Page: http://127.0.0.1:8190/" in said
    assert "systemctl" not in said
    bridge = load(init.path, Ward).bridge
    assert bridge is not None
    assert [device.id for device in bridge.devices] == ["virtual-1", "virtual-2"]


def test_machines_and_people_are_added_later_and_comments_stay(
    init: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    init("--virtual", "1")
    init.path.write_text(
        "# ours\n" + init.path.read_text().replace("[estimator]", "[estimator]  # mine\nsilence_s = 5.0")
    )
    assert init("--host", "localhost", "--bridge", "bridge-2", "--person", "nurse") == 0
    text = init.path.read_text()
    assert text.startswith("# ours\n")
    assert "[estimator]  # mine\nsilence_s = 5.0" in text
    there = init.folder / "machines/bridge-2/ward.toml"
    there.write_text(there.read_text().replace(str(init.folder / "pki"), str(there.parent / "pki")))
    assert main(["config", "check", str(init.path), str(there), str(init.folder / "router.json5")]) == 0
    for key in init.folder.rglob("*.key"):
        assert key.stat().st_mode & 0o777 == 0o600
    assert "truerate-router" not in capsys.readouterr().out.rpartition("Left to do")[2]
    assert init("--bridge", "bridge-3") == 0
    assert "systemctl restart truerate-router" in capsys.readouterr().out


def test_the_advice_about_a_certificate_that_expires_soon_renews_it_while_the_page_is_served(
    init: Installed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    init("--host", "localhost")
    old = Folder(init.folder / "authority").renew(Member(Role.PAGE, "ward-3"), utc_now() - timedelta(days=80), days=90)
    (init.folder / "pki/page.ward-3.pem").write_bytes(Path(old.certificate).read_bytes())
    port = free_port()
    init.path.write_text(init.path.read_text().replace(":8443", f":{port}"))
    with program("estimator.cli.main", "dashboard", "--config", str(init.path), log=tmp_path / "log"):
        assert wait(lambda: days_left(port, init.folder) in (9, 10)), (tmp_path / "log").read_text()
        capsys.readouterr()
        main(["doctor", str(init.path), "--json"])
        (found,) = [one for one in json.loads(capsys.readouterr().out) if one["check"] == "page certificate"]
        assert found["level"] == "warning"
        sudo, truerate, *words = shlex.split(found["do"])
        assert (sudo, truerate) == ("sudo", "truerate")
        assert main([*words, "--data", str(init.data)]) == 0
        assert wait(lambda: days_left(port, init.folder) == 89), (tmp_path / "log").read_text()
    assert "sudo truerate init ward-3" in (tmp_path / "log").read_text()


def days_left(port: int, folder: Path) -> int:
    """Days until the certificate that the page shows expires; -1 without a page."""
    trusting = ssl.create_default_context(cafile=folder / "pki/ca.pem")
    try:
        with (
            socket.create_connection(("127.0.0.1", port)) as plain,
            trusting.wrap_socket(plain, server_hostname="localhost") as page,
        ):
            ends = ssl.cert_time_to_seconds(str((page.getpeercert() or {})["notAfter"]))
    except OSError:
        return -1
    return int((ends - time.time()) // 86400)


def wait(met: Callable[[], bool], seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while not (there := met()) and time.monotonic() < end:
        time.sleep(0.3)
    return there


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bridge", "b"], "--bridge needs --host"),
        (["--person", "Nurse Joy"], "--person 'Nurse Joy'"),
        (["--virtual", "-1"], "use 0 to 100"),
        (["--host", "a b"], "etc/ward.toml: [dashboard]: hosts: 'a b'"),
    ],
)
def test_a_wrong_argument_is_said_and_nothing_is_written(
    init: Installed, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert init(*words) == 2
    assert said in capsys.readouterr().err
    assert not init.folder.exists()


def test_the_advice_for_another_host_and_another_ward_helps(
    init: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    init("--host", "localhost")
    assert init(ward="ward-4") == 2
    assert "of ward 'ward-3'" in capsys.readouterr().err
    assert init("--host", "10.0.0.5") == 2
    said = capsys.readouterr().err
    for path in (init.folder / "authority").glob("page.*"):
        assert str(path) in said
        path.unlink()
    assert init("--host", "10.0.0.5") == 0
    assert load(init.path, Ward).dashboard.hosts == ("localhost", "10.0.0.5")


def test_a_program_takes_the_newest_certificate_of_its_role(init: Installed) -> None:
    init("--host", "localhost", "--bridge", "bridge-2")
    pki = init.folder / "pki"
    bus = load(init.path, Ward).bus
    for kind in ("pem", "key"):
        (pki / f"recorder.recorder-1.2.{kind}").write_bytes((pki / f"recorder.recorder-1.{kind}").read_bytes())
    recorder = bus.routers_as(Role.VIEWER, Role.RECORDER).identity
    assert recorder is not None
    assert Path(recorder.certificate).name == "recorder.recorder-1.2.pem"
    with pytest.raises(ConfigError, match=r"no certificate for bridge:bridge-9\. Run truerate pki issue bridge:"):
        bus.routers_as(Role.BRIDGE, name="bridge-9")
    with pytest.raises(ValueError, match="pki is given together with"):
        Bus(connect=("tls/a:1",), pki="pki", ca="ca.pem")


@pytest.mark.ward
@pytest.mark.xdist_group("ward 2")
def test_the_programs_of_an_installed_ward_work_with_one_file(init: Installed, tmp_path: Path) -> None:
    init("--host", "localhost", "--bridge", "bridge-2", "--virtual", "1")
    ports = {"7447": free_port(), "9464": free_port(), "9465": free_port()}
    for path in (init.path, init.folder / "router.json5"):
        text = path.read_text()
        for port, free in ports.items():
            text = text.replace(f":{port}", f":{free}")
        path.write_text(text)
    config, log = str(init.path), tmp_path / "log"
    with ExitStack() as stack:
        for words in (
            ("router", "--config", str(init.folder / "router.json5")),
            ("estimator", "serve", config),
            ("bridge", "run", config),
        ):
            stack.enter_context(program("estimator.cli.main", *words, log=log))
        routers = load(init.path, Ward).bus.routers_as(Role.COMMANDER)
        until = time.monotonic() + 60
        found = set[str]()
        while "virtual-1" not in found and time.monotonic() < until:
            try:
                with Client(routers, ward="ward-3") as client:
                    found = set(client.statuses())
                    assert not client.denied
            except BusError:
                time.sleep(0.2)  # the router is not there yet
        assert "virtual-1" in found, log.read_text()
