"""[dashboard] of a ward's file, and the verb that makes hashes."""

import io
import socket
from pathlib import Path

import pytest

from bridge.config.schema import ConfigError, load
from estimator.cli.main import main
from estimator.config.schema import Ward
from estimator.web.passwords import Passwords
from estimator.web.serve import routers_of

HASH = "$argon2id$v=19$m=64,t=1,p=4$c2FsdHNhbHRzYWx0$aGFzaGhhc2hoYXNo"


def ward(text: str, folder: Path) -> Ward:
    file = folder / "ward.toml"
    file.write_text(f'ward = "w"\n[dashboard]\n{text}', encoding="utf-8")
    return load(file, Ward)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('listen = "nowhere"', "an address looks like '127.0.0.1:8090'"),
        ('hosts = ["http://x"]', "is no name"),
        ("session_hours = 0", "0.05 to 168"),
        ("idle_minutes = 0", "1 to 10080"),
        ('[[dashboard.people]]\nname = "Nurse"\npassword = "x"', "is not valid"),
        ('[[dashboard.people]]\nname = "nurse"\npassword = "secret"', "make one with `truerate dashboard password`"),
        (2 * f'[[dashboard.people]]\nname = "nurse"\npassword = "{HASH}"\n', "two people are called 'nurse'"),
        ("port = 3", "unknown key 'port'"),
    ],
)
def test_what_is_wrong_is_said(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as error:
        ward(text, tmp_path)
    assert words in str(error.value)
    assert "secret" not in str(error.value)


@pytest.mark.parametrize(
    ("listen", "local"), [("127.0.0.1:1", True), ("localhost:1", True), ("[::1]:1", True), ("0.0.0.0:1", False)]
)
def test_whether_only_this_machine_reaches_it(listen: str, local: bool, tmp_path: Path) -> None:
    assert ward(f'listen = "{listen}"', tmp_path).dashboard.local is local


def test_a_hash_is_made_that_lets_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("a long password\n"))
    assert main(["dashboard", "password", "--name", "nurse"]) == 0
    printed = capsys.readouterr().out
    assert "a long password" not in printed
    with pytest.raises(SystemExit):
        main(["dashboard", "passwrd"])
    assert "argument password: unknown 'passwrd'" in capsys.readouterr().err
    passwords = Passwords(ward(printed, tmp_path).dashboard.people)
    assert passwords.right("nurse", "a long password")
    assert not passwords.right("nurse", "another")
    assert not passwords.right("nobody", "a long password")


def test_a_token_is_shown_once_beside_its_hash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dashboard", "password", "--name", "script", "--token"]) == 0
    captured = capsys.readouterr()
    name, _, secret = captured.err.strip().rpartition(" ")[2].partition(".")
    assert Passwords(ward(captured.out, tmp_path).dashboard.people).right(name, secret)


def certified(holder: str, text: str, folder: Path) -> Ward:
    """A ward's file of who shows a certificate."""
    folder.mkdir(exist_ok=True)
    pki = folder / "pki"
    assert main(["pki", "init", "--ward", "w", "--folder", str(pki)]) == 0
    assert main(["pki", "issue", holder, "--folder", str(pki)]) == 0
    own = holder.replace(":", ".")
    bus = (
        f'connect = ["tls/127.0.0.1:1"]\nca = "{pki}/ca.pem"\ncertificate = "{pki}/{own}.pem"\nkey = "{pki}/{own}.key"'
    )
    return ward(f"{text}\n[bus]\n{bus}\n", folder)


def test_who_does_not_hear_readings_is_told_what_that_costs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert routers_of(certified("viewer:hall", "", tmp_path)).identity is not None
    assert "viewer:hall does not hear the devices' own readings" in caplog.text


def test_who_may_give_commands_does_so_as_a_commander(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    people = f'[[dashboard.people]]\nname = "nurse"\npassword = "{HASH}"'
    assert routers_of(certified("commander:desk", people, tmp_path)).identity is not None
    assert caplog.text == ""
    with pytest.raises(ConfigError, match="needs a certificate for commander"):
        routers_of(certified("viewer:hall", people, tmp_path / "other"))


def test_a_port_that_is_taken_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        assert main(["dashboard", "--listen", listen, "--connect", "tcp/127.0.0.1:1"]) == 1
    assert f"cannot listen on {listen}: in use by another program; --listen takes another" in capsys.readouterr().err
