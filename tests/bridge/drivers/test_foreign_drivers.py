"""Drivers of other packages, as an installation offers them: metadata with entry points on the path."""

import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge.config.schema import Bridge, load
from bridge.drivers import registry
from estimator.config.schema import Ward

MODULE = """
import msgspec
from bridge.drivers import simulated
from bridge.drivers.driver import DriverKind

class Options(msgspec.Struct, frozen=True):
    volume: float = 1.0

KIND = DriverKind("theremin", "a device of somebody else", Options, simulated.KIND.make, lambda options: "there")
TAKEN = DriverKind("native", "a name of ours", Options, simulated.KIND.make, lambda options: "there")
"""
ENTRIES = """
[truerate.drivers]
theremin = somebodys_driver:KIND
taken = somebodys_driver:TAKEN
missing = somebodys_driver:NOWHERE
number = math:pi
"""
CONFIG = """
ward = "w"

[bridge]
id = "b"

[[bridge.devices]]
id = "t"
driver = "theremin"
volume = 0.5
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of somebody else."""
    (tmp_path / "somebodys_driver.py").write_text(MODULE, encoding="utf-8")
    metadata = tmp_path / "somebodys_driver-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: somebodys-driver\nVersion: 1.0\n", encoding="utf-8"
    )
    (metadata / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry.foreign.cache_clear()
    yield tmp_path
    registry.foreign.cache_clear()
    sys.modules.pop("somebodys_driver", None)


def test_it_is_known_by_its_name_and_takes_its_own_options(installed: Path) -> None:
    assert registry.kinds()["theremin"].summary == "a device of somebody else"
    file = installed / "ward.toml"
    file.write_text(CONFIG, encoding="utf-8")
    bridge = load(file, Ward).bridge
    assert isinstance(bridge, Bridge)
    assert bridge.devices[0].driver == "theremin"
    assert msgspec.to_builtins(bridge.devices[0].options) == {"volume": 0.5}


def test_what_is_no_driver_or_takes_a_name_of_ours_is_left_out_aloud(
    installed: Path, caplog: pytest.LogCaptureFixture
) -> None:
    found = registry.kinds()
    assert installed.is_dir()
    assert found["native"].summary != "a name of ours"
    assert list(found) == [*registry.OURS, "theremin"]
    assert len(found) == len(registry.OURS) + 1
    for name in ("taken", "missing", "number"):
        assert f"driver {name} (" in caplog.text
