"""Whatever devices, files and people say: a line of the log is ours, a terminal shows it, and no secret stands in it."""

import json
import logging
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.pki.authority import new_authority
from bridge.runtime import logs
from estimator.cli.main import main
from tests.bridge.wire.test_keys import HOSTILE

KEY = new_authority("w", datetime(2026, 1, 1, tzinfo=UTC)).key.decode()
HASH = "$argon2id$v=19$m=65536,t=3,p=4$c2FsdHNhbHQ$aGFzaGhhc2g"
FORGED = "x\nERROR estimator: all is lost\r\x1b[2J\u2028\u202e\x9b1mINFO\0"


def record(message: str, *, fails: bool = False) -> logging.LogRecord:
    info = None
    if fails:
        try:
            raise ValueError(message)
        except ValueError:
            info = sys.exc_info()
    return logging.LogRecord("estimator.service", logging.WARNING, __file__, 1, "%s: came", (message,), info)


@pytest.mark.parametrize("text", [*HOSTILE, FORGED], ids=lambda text: ascii(text[:12]))
@pytest.mark.parametrize("fails", [False, True])
def test_no_text_makes_a_line_of_its_own(text: str, fails: bool) -> None:
    first, *trace = logs.TextFormatter().format(record(text, fails=fails)).split("\n")
    assert first.startswith("WARNING estimator.service: ")
    assert bool(trace) is fails
    assert all(line.isprintable() for line in [first, *trace])
    assert all(line.startswith("  | ") for line in trace)
    line = logs.JsonFormatter().format(record(text, fails=fails))
    assert line.isprintable()
    said = json.loads(line)
    assert said.keys() == {"time", "level", "logger", "message", *(["trace"] if fails else [])}
    assert (said["level"], said["logger"]) == ("warning", "estimator.service")
    assert len(line) < 6 * logs.LONGEST + 2 * len(text) * fails + 5000


@given(st.text())
def test_what_can_be_seen_stays_and_what_cannot_is_escaped(text: str) -> None:
    shown = logs.printable(text)
    assert shown.isprintable()
    if text.isprintable() and "$argon2" not in text:
        assert shown == text


@pytest.mark.parametrize("secret", [KEY, HASH, KEY[:200]], ids=["key", "hash", "cut"])
@pytest.mark.parametrize("formatter", [logs.TextFormatter(), logs.JsonFormatter()], ids=logs.FORMATS)
def test_secrets_are_left_out_wherever_they_came_from(formatter: logging.Formatter, secret: str) -> None:
    for fails in (False, True):
        said = formatter.format(record(f"before {secret} after", fails=fails))
        assert logs.HIDDEN in said
        for line in secret.split("\n")[1:-2] or [secret[-20:]]:
            assert line not in said
        assert "before" in said


def test_a_key_that_stands_where_its_file_belongs_is_not_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bridge-1.toml"
    files = f'ca = "ca.pem"\ncertificate = "b.pem"\nkey = """{KEY}"""\n'
    path.write_text(f'ward = "w"\n[bus]\nconnect = ["tls/127.0.0.1:7447"]\n{files}')
    assert main(["config", "check", str(path)]) == 2
    said = capsys.readouterr().err
    assert logs.HIDDEN in said
    assert not [line for line in KEY.split("\n")[1:-2] if line in said]


@pytest.fixture
def hostile_file(tmp_path: Path) -> Path:
    path = tmp_path / "w\nERROR truerate: no.toml"
    path.write_text('ward = "w"\n[[dashboard.people]]\nname = "nurse"\npassword = "hunter2-in-the-clear"\n')
    return path


@pytest.mark.parametrize("form", logs.FORMATS)
def test_a_command_that_fails_says_so_in_its_form_and_tells_no_password(hostile_file: Path, form: str) -> None:
    words = [sys.executable, "-m", "estimator.cli.main", "--log-format", form, "config", "check", str(hostile_file)]
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    assert found.returncode == 2
    lines = found.stderr.splitlines()
    if form == logs.JSON:
        (said,) = map(json.loads, lines)
        assert "password of 'nurse' is not a hash" in said["message"]
    else:
        assert [line for line in lines if not line.startswith("  ")] == lines[:1]
    assert "hunter2" not in found.stderr + found.stdout


@pytest.mark.parametrize("verb", [["bridge", "list"], ["pki", "show", "--folder"]])
def test_every_verb_says_errors_in_the_form_that_was_asked_for(
    verb: list[str], capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    assert main(["--log-format", "json", *verb, "no\x1b[2Jwhere"]) == 2
    assert capsys.readouterr().err == ""
    assert len(caplog.messages) == 1
    assert main([*verb, "no\x1b[2Jwhere"]) == 2
    assert "no\\x1b[2Jwhere: " in capsys.readouterr().err


def test_a_misspelt_verb_is_told_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    for words, nearest in (
        (["statsu"], "status"),
        (["pki", "isue"], "issue"),
        (["--log-format", "jsno", "status"], "json"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
        assert f"did you mean '{nearest}'?" in capsys.readouterr().err
