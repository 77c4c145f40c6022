"""docs/devices.md: every driver has its place, and every block of TOML in it is taken as it stands."""

import re
from pathlib import Path

import pytest

from bridge.config.schema import Root, load
from bridge.drivers import registry
from bridge.text.profile import Profile, shipped

DOC = (Path(__file__).parents[3] / "docs" / "devices.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", DOC, re.DOTALL)


def test_every_driver_and_profile_is_told_of() -> None:
    headings = {word.strip() for line in re.findall(r"^## (.*)$", DOC, re.MULTILINE) for word in line.split(",")}
    assert {*registry.OURS} <= headings
    assert all(f"| `{name}` |" in DOC for name in shipped())


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_is_taken(block: str, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    devices = block.startswith("[[bridge.devices]]")
    path.write_text(f'ward = "w"\n[bridge]\nid = "b"\n{block}' if devices else block, encoding="utf-8")
    load(path, Root if devices else Profile)
