"""Files that devices are played from: `truerate config check` looks at them, and says what is wrong."""

import os
from pathlib import Path

import pytest

from bridge.config import capture_files
from bridge.config.schema import Bridge, Root, load
from bridge.runtime import os_errors
from estimator.cli.main import main

FILE = """ward = "w"
[bridge]
id = "b"
[[bridge.devices]]
id = "d1"
driver = "replayed"
file = "{folder}/{recording}"
[[bridge.devices]]
id = "d2"
driver = "native"
port = "file://{folder}/{capture}?bytes_per_s=100"
[[bridge.devices]]
id = "d3"
driver = "native"
port = "/dev/not-plugged-in-here"
"""


def ward(folder: Path, recording: str, capture: str) -> Path:
    path = folder / "ward.toml"
    path.write_text(FILE.format(folder=folder, recording=recording, capture=capture))
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "there.npz").touch()
    (tmp_path / "a folder.npz").mkdir()
    return tmp_path


def test_files_that_are_there_are_right_and_ports_are_not_looked_at(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", str(ward(folder, "there.npz", "there.npz"))]) == 0
    assert "valid" in capsys.readouterr().out


def test_each_file_that_is_not_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(ward(folder, "a folder.npz", "none.bin"))]) == 2
    said = capsys.readouterr().err
    assert f"device 'd1': {folder}/a folder.npz: a folder, but a file is expected" in said
    assert f"device 'd2': file://{folder}/none.bin?bytes_per_s=100: there is no such file" in said
    assert "d3" not in said


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_named(folder: Path) -> None:
    (folder / "there.npz").chmod(0)
    root = load(ward(folder, "there.npz", "there.npz"), Root)
    assert isinstance(root.bridge, Bridge)
    assert all("no permission" in words for words in capture_files.unreadable(root.bridge.devices))


def test_errors_of_the_system_have_no_numbers(tmp_path: Path) -> None:
    said = []
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(OSError, match="Errno") as raised:
            path.read_text()
        said.append(os_errors.said(raised.value))
    assert said[0] == f"{tmp_path}: a folder, but a file is expected"
    assert said[1] == f"{tmp_path}/none: there is no such file or folder"
    assert not any("Errno" in words for words in said)
    assert os_errors.said(OSError("of our own")) == "of our own"
