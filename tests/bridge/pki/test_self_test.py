"""A program that a router denies everything says so itself, and so does one whose router denies nobody anything."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from bridge.bus.access_self_test import self_test
from bridge.bus.routers import Routers
from bridge.pki.folder import utc_now
from bridge.pki.member import Member
from estimator.cli.main import main
from estimator.client import Client
from tests.bridge.pki.guarded_ward import MEMBERS, WARD, GuardedWard
from tests.memory_bus import MemoryBroker, MemoryBus

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: self test")]


def test_each_role_finds_itself_known_and_a_stranger_does_not(tmp_path: Path) -> None:
    ward = GuardedWard(tmp_path / "pki")
    ward.write(by_issuers=False)
    ward.folder.issue(Member.parse("bridge:late"), utc_now())  # the router's file is older
    config = tmp_path / "late.toml"
    files = ward.routers("bridge:late").identity
    assert files is not None
    config.write_text(
        f'ward = "{WARD}"\n[bus]\nconnect = ["{ward.endpoint}"]\nca = "{files.ca}"\ncertificate = "{files.certificate}"\n'
        f'key = "{files.key}"\n[bridge]\nid = "late"\n[[bridge.devices]]\nid = "d"\ndriver = "simulated"\n'
    )
    with ward.running():
        for who in MEMBERS:
            with ward.bus(who) as bus:
                assert self_test(bus, ward.routers(who), WARD, wait_s=60.0) == []
        with ward.bus("bridge:b1") as bus:  # of another ward
            assert [
                words for words in self_test(bus, ward.routers("bridge:b1"), "w2", wait_s=0.5) if "drops all" in words
            ]
        process = subprocess.Popen(
            [sys.executable, "-m", "estimator.cli.main", "bridge", "run", str(config)],
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert process.stderr is not None
            deadline, said = time.monotonic() + 60, ""
            while "drops all messages to and from bridge:late" not in said:
                said = process.stderr.readline()
                assert said, "it ended without a word"
                assert time.monotonic() < deadline
        finally:
            process.terminate()
            process.communicate()


def test_a_subscriber_is_told_that_it_is_denied(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ward = GuardedWard(tmp_path / "pki")
    ward.write(by_issuers=False)
    ward.folder.issue(Member.parse("viewer:late"), utc_now())  # the router's file is older
    with ward.running():
        with Client(ward.routers("viewer:v1"), ward=WARD) as client:
            assert client.denied == ()
        with Client(ward.routers("viewer:late"), ward=WARD) as client:
            [words] = client.denied
        assert "drops all messages to and from viewer:late" in words
        assert words in caplog.text
        with Client(ward.routers("bridge:b1"), ward=WARD) as client:
            [words] = client.denied
        assert "is for bridge:b1" in words


def test_a_recorder_is_told_that_it_is_denied(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ward, config = GuardedWard(tmp_path / "pki"), tmp_path / "late.toml"
    ward.write(by_issuers=False)
    files = ward.folder.issue(Member.parse("recorder:late"), utc_now())
    config.write_text(
        f'ward = "{WARD}"\n[bus]\nconnect = ["{ward.endpoint}"]\nca = "{files.ca}"\ncertificate = "{files.certificate}"\n'
        f'key = "{files.key}"\n[recorder]\nfolder = "{tmp_path}"\n'
    )
    with ward.running():
        main(["record", "--wait", "1", "--config", str(config)])
    assert caplog.text.count("drops all messages to and from recorder:late") == 1


def test_a_plain_bus_has_nothing_to_try() -> None:
    assert self_test(MemoryBus(MemoryBroker()), Routers(("tcp/127.0.0.1:1",)), WARD) == []
