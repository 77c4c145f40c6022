"""What is deployed is pinned by version and hash, all of it, and the bill of materials lists the same."""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests import bill

ROOT = Path(__file__).parent.parent
DEPLOY, BUILD = ROOT / "requirements/deploy.txt", ROOT / "requirements/build.txt"
_SHA256 = re.compile(r"--hash=sha256:[0-9a-f]{64}")


def entries(path: Path) -> dict[Requirement, list[str]]:
    """Requirements and their hashes."""
    text = re.sub(r"\\\n\s+", " ", path.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    return {Requirement(line.partition("--hash")[0].strip()): _SHA256.findall(line) for line in lines}


def pinned(path: Path) -> dict[str, str]:
    """Names and versions for this machine."""
    found = dict[str, str]()
    for requirement in entries(path):
        if requirement.marker is None or requirement.marker.evaluate():
            (pin,) = requirement.specifier
            found[canonicalize_name(requirement.name)] = pin.version
    return found


@pytest.mark.parametrize("path", [DEPLOY, BUILD], ids=lambda path: path.stem)
def test_nothing_is_unpinned(path: Path) -> None:
    found = entries(path)
    assert found
    for requirement, hashes in found.items():
        assert [pin.operator for pin in requirement.specifier] == ["=="], requirement
        assert "*" not in str(requirement.specifier)
        assert requirement.url is None
        assert hashes, f"{requirement} has no hash"


def test_the_pins_are_what_the_package_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    asked = list(chain(project["project"]["dependencies"], *project["project"]["optional-dependencies"].values()))
    versions = pinned(DEPLOY)
    for text in asked:
        requirement = Requirement(text)
        version = versions.get(canonicalize_name(requirement.name))
        assert version is not None, f"{text} is not pinned; run `make pins`"
        assert requirement.specifier.contains(version), f"{text} is pinned to {version}; run `make pins`"
    assert "setuptools" in pinned(BUILD), "what comes as source alone is built by it"
    (build,) = project["build-system"]["requires"]
    assert Requirement(build).specifier.contains(pinned(BUILD)["hatchling"])


def test_what_the_pinned_need_is_pinned_too() -> None:
    versions = pinned(DEPLOY)
    for name in versions:
        try:
            needs = requires(name) or []
        except PackageNotFoundError:
            continue  # an extra that is not installed here
        for need in map(Requirement, needs):
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                assert canonicalize_name(need.name) in versions, f"{name} needs {need}"


def test_the_bill_of_materials_lists_what_is_pinned(tmp_path: Path) -> None:
    out = tmp_path / "sbom.json"
    words = [sys.executable, "-W", "ignore", "-m", "cyclonedx_py", "requirements", str(DEPLOY), "--pyproject"]
    subprocess.run(
        [*words, str(ROOT / "pyproject.toml"), "--of", "JSON", "-o", str(out)], check=True, capture_output=True
    )
    said = json.loads(out.read_text(encoding="utf-8"))
    assert said["bomFormat"] == "CycloneDX"
    assert said["metadata"]["component"]["name"] == "truerate"
    listed = {(canonicalize_name(c["name"]), c["version"]) for c in said["components"]}
    assert listed == {
        (canonicalize_name(requirement.name), next(iter(requirement.specifier)).version)
        for requirement in entries(DEPLOY)
    }
    assert all(reference["hashes"] for c in said["components"] for reference in c["externalReferences"])


def test_what_lies_in_the_package_is_in_the_bill_too(tmp_path: Path) -> None:
    out = tmp_path / "sbom.json"
    out.write_text('{"components": []}', "utf-8")
    for _ in range(2):
        bill.main(out)
    (uplot,) = json.loads(out.read_text("utf-8"))["components"]
    content = (bill.VENDOR / "uPlot.iife.min.js").read_bytes()
    assert (uplot["name"], uplot["hashes"][0]["content"]) == ("uPlot", hashlib.sha256(content).hexdigest())
    assert uplot["version"].encode() in content[:100]


def test_what_is_deployed_is_installed_as_the_document_says() -> None:
    """SECURITY.md's lines are those that `make supply` tries, and nothing is built by what has no hash."""
    commands = re.findall(r"(?m)^pip (install .*)$", (ROOT / "SECURITY.md").read_text(encoding="utf-8"))
    tried = (ROOT / "Makefile").read_text(encoding="utf-8").replace("install --quiet ", "install ")
    assert len(commands) == 3
    for command in commands:
        assert f"pip {command}\n" in tried
    assert [("--no-build-isolation" in command) for command in commands] == [False, True, True]
