"""docs/security.md can be followed to the letter."""

import re
import shlex
from pathlib import Path

import pytest

from estimator.cli.main import main

DOC = Path(__file__).parents[3] / "docs" / "security.md"


def test_its_commands_make_a_ward_that_is_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = DOC.read_text("utf-8")
    verbs = "init |issue |router r|renew |revoke |revoke-list|show"
    commands = re.findall(rf"(?m)(?:^ *|`)(truerate pki (?:{verbs})[^`\n]*)", text)
    assert len(commands) >= 9
    for command in commands:
        words, _, file = command.partition("#")[0].partition(" > ")
        assert main(shlex.split(words)[1:]) == 0, command
        said = capsys.readouterr().out
        if file:
            (tmp_path / file.strip()).write_text(said)
    router = (tmp_path / "router.json5").read_text()
    assert '"bridge:bridge-1:2"' in router
    assert '"bridge:bridge-1"' not in router
    table = re.search(r"\[bus\](?:\n +\w+ = .*)+", text)
    assert table is not None
    (tmp_path / "router.json5").write_text(router.replace("/etc/truerate", str(tmp_path)))
    bus = table[0].replace("/etc/truerate", str(tmp_path))
    (tmp_path / "bridge-1.toml").write_text(f'ward = "ward-3"\n{bus}\n[bridge]\nid = "bridge-1"\n')
    assert main(["config", "check", "bridge-1.toml", "router.json5"]) == 0
