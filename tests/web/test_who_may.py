"""Who may change something, and how often somebody may try."""

import time
from pathlib import Path

import pytest
from starlette.routing import Route

from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from bridge.wire import keys
from estimator.cli.main import main
from estimator.config.dashboard import Person
from estimator.web.api import openapi
from estimator.web.app import routes
from estimator.web.client_address import neighbourhood
from estimator.web.cookie import NAME
from estimator.web.login_attempts import ADDRESS_FREE, FORGET_S, FREE, NAME_FREE, Attempts
from estimator.web.sessions import SESSIONS, Sessions
from tests.web.asking import PEOPLE, Asking
from tests.web.talk import about, said


def test_tries_are_forgiven_and_forgotten() -> None:
    attempts = Attempts()
    for _ in range(FREE):
        assert attempts.wait_s("a", "nurse", 0.0) == 0.0
        attempts.failed("a", "nurse", 0.0)
    assert attempts.wait_s("a", "nurse", 0.0) == pytest.approx(FORGET_S)
    assert attempts.wait_s("a", "nurse", FORGET_S) == 0.0
    assert attempts.wait_s("a", "script", 0.0) == 0.0
    assert attempts.wait_s("b", "nurse", 0.0) == 0.0


def test_a_password_of_ones_own_does_not_let_one_guess_for_ever() -> None:
    attempts, taken = Attempts(), 0
    for _ in range(100):
        for _ in range(4):
            if attempts.wait_s("a", "nurse", 0.0) == 0.0:
                attempts.failed("a", "nurse", 0.0)
                taken += 1
        attempts.succeeded("a", "script")
    assert taken == FREE
    attempts.succeeded("a", "nurse")
    assert attempts.wait_s("a", "nurse", 0.0) == 0.0
    while attempts.wait_s("a", f"name {taken}", 0.0) == 0.0:
        attempts.failed("a", f"name {taken}", 0.0)
        attempts.succeeded("a", "script")
        taken += 1
    assert taken == ADDRESS_FREE


def test_a_name_is_not_guessed_from_many_addresses_and_one_alone_does_not_lock_it() -> None:
    attempts, taken = Attempts(), 0
    while attempts.wait_s("a", "nurse", 0.0) == 0.0:
        attempts.failed("a", "nurse", 0.0)
    assert attempts.wait_s("b", "nurse", 0.0) == 0.0
    for address in map(str, range(100)):
        while attempts.wait_s(address, "nurse", 0.0) == 0.0:
            attempts.failed(address, "nurse", 0.0)
            taken += 1
    assert taken == NAME_FREE - FREE


def test_who_had_the_right_password_is_not_locked_out_by_strangers_elsewhere() -> None:
    attempts = Attempts()
    attempts.succeeded("ward", "nurse")
    for address in map(str, range(100)):
        while attempts.wait_s(address, "nurse", 0.0) == 0.0:
            attempts.failed(address, "nurse", 0.0)
    assert attempts.wait_s("home", "nurse", 0.0) > 0.0
    assert attempts.wait_s("ward", "nurse", 0.0) == 0.0
    for _ in range(FREE):
        attempts.failed("ward", "nurse", 0.0)
    assert attempts.wait_s("ward", "nurse", 0.0) > 0.0, "nobody guesses for ever there either"


@pytest.mark.parametrize(
    ("address", "whom"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("::ffff:10.0.0.7", "10.0.0.7"),
        ("fe80::1%eth0", "fe80::/64"),
        ("testclient", "testclient"),
        ("", ""),
    ],
)
def test_whom_an_address_stands_for(address: str, whom: str) -> None:
    assert neighbourhood(address) == whom


def test_a_session_ends_by_itself() -> None:
    sessions = Sessions(60.0, 60.0)
    cookie = sessions.begin("nurse", 0.0)
    found = sessions.find(cookie, 59.0)
    assert found is not None
    assert found.name == "nurse"
    assert sessions.find(cookie + "x", 0.0) is None
    assert sessions.find(None, 0.0) is None
    assert sessions.find(cookie, 60.0) is None
    assert sessions.find(cookie, 0.0) is None


def test_of_too_many_sessions_the_oldest_ends() -> None:
    sessions = Sessions(60.0, 60.0)
    cookies = [sessions.begin("nurse", 0.0) for _ in range(SESSIONS + 1)]
    assert sessions.find(cookies[0], 0.0) is None
    assert sessions.find(cookies[1], 0.0) is not None


def _changing() -> list[tuple[str, str]]:
    """Every way to change something over HTTP: method and path."""
    found = [(route.path, route.methods or set()) for route in routes() if isinstance(route, Route)]
    return [(method, path) for path, methods in found for method in methods - {"GET", "HEAD"}]


def test_no_way_to_change_something_is_undocumented() -> None:
    documented = {
        (method.upper(), path)
        for path, ways in openapi.document()["paths"].items()
        for method in ways
        if method != "get"
    }
    assert {way for way in _changing() if way[1].startswith("/api/")} == documented
    assert len(documented) >= 5


@pytest.mark.parametrize("people", [PEOPLE, ()], ids=["people", "nobody may"])
def test_who_only_looks_changes_nothing_on_any_route(people: tuple[Person, ...]) -> None:
    asking = Asking(people=people)
    open_to_all = ("/login", "/welcome")  # the second needs the secret of a one-time link
    ways = [(method, path.replace("{device}", "chest")) for method, path in _changing() if path not in open_to_all]
    with asking.client as client:
        asking.hear(about("chest", boot=5), said("chest", boot=5, time_ns=time.time_ns()))
        if people:  # somebody who is logged in, led to it by another site's page
            asking.log_in()
            assert {way: client.request(*way).status_code for way in ways} == dict.fromkeys(ways, 403)
        client.cookies.clear()
        for headers in ({}, {"Authorization": "Bearer nurse.guessed"}, {"Cookie": f"{NAME}=guessed"}):
            for method, path in ways:
                body = {"json": {"words": "x"}} if path.startswith("/api/") else {"data": {"words": "x", "csrf": "x"}}
                answer = client.request(method, path, headers=headers, **body)  # type: ignore[arg-type]
                assert answer.status_code in (401, 429), (path, headers)
    asking.talk.hush()
    assert asking.talk.asked == []


#: a command line for each command on the bus
COMMANDS = {
    "recalibrate": ["recalibrate", "chest"],
    "cancel": ["cancel", "chest"],
    "note": ["note", "chest", "sat up"],
    "zero-heading": ["zero-heading"],
    "forget": ["forget", "chest"],
    "erase": ["forget", "chest", "--yes"],
    "place": ["placement", "set", "chest", "--wearer", "P07"],
    "acknowledge": ["alerts", "acknowledge", "chest"],
}


FILES = 'ca = "{pki}/ca.pem"\ncertificate = "{pki}/viewer.hall.pem"\nkey = "{pki}/viewer.hall.key"'


@pytest.mark.parametrize("named", ['pki = "{pki}"', FILES], ids=["folder", "files"])
def test_a_viewers_certificate_sends_no_command(named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert set(COMMANDS) == set(keys.VERBS)
    folder, file = Folder(tmp_path / "pki"), tmp_path / "ward.toml"
    folder.make("a ward", utc_now())
    folder.issue(Member.parse("viewer:hall"), utc_now())
    file.write_text(f'ward = "w"\n[bus]\nconnect = ["tls/127.0.0.1:1"]\n{named.format(pki=folder.path)}\n')
    for words in (*COMMANDS.values(), ["placement", "end", "chest"], ["calibrate", "--live", "chest"]):
        assert main([*words, "--config", str(file)]) > 0
        assert "certificate for commander" in capsys.readouterr().err, words
