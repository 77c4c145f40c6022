"""The C program that calibrates counts from standard input."""

import shutil
from pathlib import Path

import pytest

from tests.embedded.host_program import build


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc")
    return build(tmp_path_factory.mktemp("embedded"))
