"""An authority of some months, a bridge and a viewer."""

from pathlib import Path

import pytest

from bridge.pki.folder import Folder, utc_now
from estimator.cli.main import main
from tests.bridge.pki.office import DAY


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    made = tmp_path / "pki"
    Folder(made).make("truerate w", utc_now() - 100 * DAY)
    assert main(["pki", "issue", "bridge:b1", "viewer:hall", "--folder", str(made)]) == 0
    return made
