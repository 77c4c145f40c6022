"""A ward file that changes while a program runs: what takes effect, what waits for a restart, and what is refused."""

import logging
import os
from pathlib import Path

import pytest

from bridge.bus.routers import Routers
from bridge.config.schema import ConfigError, Root
from bridge.config.ward_file import SETTLED_S, WardFile, digest_of
from bridge.pki.member import Role
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.runtime.regular_file import MAX_BYTES
from bridge.wire import keys
from bridge.wire.codec import decode_reply
from estimator.config.schema import Ward
from tests.memory_bus import MemoryBroker, MemoryBus

TEXT = 'ward = "w"\n[bridge]\nid = "b1"\n'
A, B, C = (f'[[bridge.devices]]\nid = "{name}"\ndriver = "simulated"\n' for name in "abc")


class Change:
    """A ward file and the program that looks at it; a clock in steps."""

    def __init__(self, path: Path, text: str) -> None:
        self.path, self.now = path, 0.0
        path.write_text(text, "utf-8")
        self.file = WardFile(path, Root, ("bridge",), ("bridge.devices",))
        self.file.look(self.now)

    def to(self, text: str) -> Root | None:
        self.path.write_text(text, "utf-8")
        return self.after_a_while()

    def after_a_while(self) -> Root | None:
        found = []
        for _ in range(3):
            self.now += SETTLED_S
            found.append(self.file.look(self.now))
        return next(filter(None, found), None)

    @property
    def said(self) -> str:
        return english(*self.file.report.message)


@pytest.fixture
def change(tmp_path: Path) -> Change:
    return Change(tmp_path / "w.toml", TEXT + A + B)


def test_devices_that_came_left_and_changed_are_named(change: Change) -> None:
    root = change.to(TEXT + A.replace("simulated", 'simulated"\nseed = "7').replace('"7"', "7") + C)
    assert root is not None
    assert root.bridge is not None
    assert [device.id for device in root.bridge.devices] == ["a", "c"]
    assert change.said == "Now in force from the ward file: bridge.devices ~a -b +c."
    assert change.file.report.accepted
    assert change.to(TEXT + C) is not None
    assert change.said == "Now in force from the ward file: bridge.devices -a."


def test_a_file_that_says_the_same_changes_nothing(change: Change) -> None:
    assert change.after_a_while() is None
    root = change.to(TEXT + "\n# a comment\n" + A + B)
    assert root is not None
    assert change.file.report.message == (Code.WARD_FILE_IN_FORCE(),)


@pytest.mark.parametrize("text", [TEXT + A + A, TEXT + "batch_ms = 1\n" + A, "ward = ", ""])
def test_an_invalid_file_is_refused_whole(change: Change, text: str, caplog: pytest.LogCaptureFixture) -> None:
    before = change.file.root
    assert change.to(text) is None
    assert change.file.root is before
    assert not change.file.report.accepted
    assert change.said.startswith("The changed ward file is refused. The earlier settings stay in force. The fault: ")
    assert change.after_a_while() is None
    assert [record.levelno for record in caplog.records] == [logging.ERROR], "logged once"
    assert change.to(TEXT + A) is not None


def test_a_file_is_read_when_nobody_writes_it_any_more(change: Change) -> None:
    for n in range(5):
        change.path.write_text(f"{TEXT}{A}# {'x' * n}", "utf-8")
        change.now += SETTLED_S * 0.8
        assert change.file.look(change.now) is None
    assert change.after_a_while() is not None


def test_what_needs_a_restart_is_named_until_the_restart(change: Change) -> None:
    moved = TEXT.replace("[bridge]", '[bus]\nconnect = ["tcp/10.0.0.9:7447"]\n[bridge]')
    for text in (moved + A + B, moved + A):
        change.to(text)
        assert Code.WARD_FILE_NEEDS_RESTART(settings="bus.connect") in change.file.report.message
        assert Code.WARD_FILE_IN_FORCE() not in change.file.report.message
        assert not change.file.report.accepted
    change.to(TEXT + A)
    assert change.file.report.message == (Code.WARD_FILE_IN_FORCE(),)


def test_a_program_tells_which_content_it_has_read(change: Change) -> None:
    broker = MemoryBroker()
    key = keys.build("w", "config", role="bridge", name="b1")
    with MemoryBus(broker) as bus, MemoryBus(broker) as asker:
        change.file.answer(bus, Routers.of(("tcp/127.0.0.1:1",)), Role.BRIDGE, "b1")
        for text in (TEXT + B, "ward = "):
            change.to(text)
            reply = decode_reply(asker.ask(key, b""))
            assert reply.request_id == digest_of(change.path)
            assert reply.accepted == (text != "ward = ")


def test_no_hash_of_a_password_is_shown(tmp_path: Path) -> None:
    text = 'ward = "w"\n[[dashboard.people]]\nname = "nurse"\npassword = "$argon2id$one"\n'
    path = tmp_path / "w.toml"
    path.write_text(text, "utf-8")
    file = WardFile(path, Ward, ("dashboard",), ("dashboard.people",))
    path.write_text(text.replace("$one", "$two"), "utf-8")
    assert file.look(1e9) is None
    assert file.look(2e9) is not None
    assert english(*file.report.message) == "Now in force from the ward file: dashboard.people ~nurse."


def test_a_program_does_not_start_with_an_invalid_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        WardFile(tmp_path / "none.toml", Root, (), ())


@pytest.mark.parametrize("name", ["a", '"a.\\"b"', "'a'"])
def test_a_name_of_20000_parts_is_refused_before_it_is_taken_apart(change: Change, name: str) -> None:
    assert change.to(TEXT + "x = {" + " . ".join([name] * 20_000) + " = 1}") is None  # 1.5 GB, and 8 s
    assert "line 4: a dotted name has more than 16 parts" in change.said


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "huge"])
def test_what_is_no_file_of_a_ward_is_refused_without_reading_on(change: Change, kind: str) -> None:
    change.path.unlink()
    if kind == "pipe":
        os.mkfifo(change.path)  # opening it would wait for a writer
    elif kind == "device":
        change.path.symlink_to("/dev/zero")  # reading it would never end
    elif kind == "folder":
        change.path.mkdir()
    else:
        with change.path.open("wb") as file:
            file.truncate(MAX_BYTES + 1)
    assert change.after_a_while() is None
    said = {
        "pipe": "a pipe or a device",
        "device": "a pipe or a device",
        "folder": "a folder",
        "huge": "the file has more than",
    }
    assert said[kind] in change.said
    assert digest_of(change.path) == ""
    change.path.rmdir() if kind == "folder" else change.path.unlink()
    assert change.to(TEXT + A) is not None
