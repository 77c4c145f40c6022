"""SECURITY.md: every threat has a line, every line a proof that is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
LINES = dict(re.findall(r"^\| (T\d+) \|(.*)$", TEXT, re.MULTILINE))


def test_what_zenoh_deserializes_is_not_used() -> None:
    """T16 says so."""
    sources = [path for package in ("bridge", "estimator") for path in (ROOT / package).rglob("*.py")]
    assert [path for path in sources if "z_deserialize" in path.read_text(encoding="utf-8")] == []


def test_each_threat_has_a_proof_that_is_there() -> None:
    assert list(LINES) == [f"T{n}" for n in range(1, 29)]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for threat, line in LINES.items():
        commands = re.findall(r"`((?:t|make|python -m) [^`]+)`", line)
        assert commands, threat
        for command in commands:
            for path in re.findall(r"tests/\S+", command):
                assert (ROOT / path).exists(), f"{threat}: {path}"
            for module in re.findall(r"-m (tests\S+)", command):
                assert (ROOT / f"{module.replace('.', '/')}.py").exists(), f"{threat}: {module}"
            for target in re.findall(r"^make (\S+)", command):
                assert f"\n{target}:" in makefile, f"{threat}: {target}"
            for words in re.findall(r'-k "?([^"]+)"?$', command):
                sources = [
                    path.read_text(encoding="utf-8") for path in map(ROOT.joinpath, re.findall(r"tests/\S+", command))
                ]
                for word in words.split(" or "):
                    assert any(re.search(rf"def test_\w*{word}", source) for source in sources), f"{threat}: {word}"
