"""An authority, a bridge and a viewer."""

from pathlib import Path

import pytest

from estimator.cli import main


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    made = tmp_path / "pki"
    assert main(["pki", "init", "--ward", "w", "--folder", str(made)]) == 0
    assert main(["pki", "issue", "bridge:b1", "viewer:hall", "--folder", str(made)]) == 0
    return made
