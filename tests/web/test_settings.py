"""[dashboard] of a ward's file."""

import socket
from pathlib import Path

import pytest

from bridge.config.schema import ConfigError, load
from estimator.cli.main import main
from estimator.config.schema import Ward
from estimator.web.serve import routers_of

HASH = "$argon2id$v=19$m=64,t=1,p=4$c2FsdHNhbHRzYWx0$aGFzaGhhc2hoYXNo"


def ward(text: str, folder: Path) -> Ward:
    file = folder / "ward.toml"
    file.write_text(f'ward = "w"\n[dashboard]\n{text}', encoding="utf-8")
    return load(file, Ward)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('listen = "nowhere"', "write for example '127.0.0.1:8090'"),
        ('hosts = ["http://x"]', "is not a host name"),
        ("session_hours = 0", "0.05 to 168"),
        ("idle_minutes = 0", "1 to 10080"),
        ('[[dashboard.people]]\nname = "Nurse"\npassword = "x"', "is not valid"),
        ('[[dashboard.people]]\nname = "nurse"\npassword = "secret"', "let `truerate people password` write it"),
        (2 * f'[[dashboard.people]]\nname = "nurse"\npassword = "{HASH}"\n', "two people are called 'nurse'"),
        ("port = 3", "unknown key 'port'"),
        (
            f'people_file = "p.toml"\n[[dashboard.people]]\nname = "nurse"\npassword = "{HASH}"',
            "both list people: move all people to",
        ),
        (f'[[dashboard.people]]\nname = "a"\nrole = "king"\npassword = "{HASH}"', "unknown value 'king'"),
        (
            '[dashboard.openid]\nissuer = "http://login.example"\nclient_id = "t"\nsecret_file = "s"\nroles = {}',
            "issuer is",
        ),
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


def test_who_gives_no_password_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(_: str) -> str:
        raise EOFError

    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("getpass.getpass", ended)
    ward("", tmp_path)
    assert main(["people", "add", "nurse", "--config", str(tmp_path / "ward.toml")]) == 2
    assert "truerate: no password was given" in capsys.readouterr().err


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
    assert "viewer:hall may not receive raw readings" in caplog.text


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
    assert (
        f"cannot listen on {listen}: in use by another program; choose another with --listen" in capsys.readouterr().err
    )
