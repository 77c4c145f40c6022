"""Errors of the system in plain words."""

from pathlib import Path

import pytest

from bridge.runtime import os_errors


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
