"""docs/validation.md: each test that shows a requirement exists, and each package that is installed is listed."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs/validation.md").read_text("utf-8")
SHOWN = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT)


def test_every_requirement_has_a_test() -> None:
    numbers = [int(n) for n in re.findall(r"^\| R(\d+) \| .* \| `tests/.*` \|$", TEXT, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 20


@pytest.mark.parametrize(("file", "name"), SHOWN, ids=[name for _, name in SHOWN])
def test_the_named_test_exists(file: str, name: str) -> None:
    assert f"def {name}(" in (ROOT / file).read_text("utf-8")


def test_every_package_is_listed() -> None:
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert not [name for one in needed if f"`{(name := re.split(r'[<>=]', one)[0])}`" not in TEXT]
