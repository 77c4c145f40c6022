"""People of a ward, managed by command and on the page: their file is changed in place, and takes effect without a restart."""

import io
import re
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from argon2 import PasswordHasher
from starlette.testclient import TestClient

from bridge.config.schema import load
from estimator.cli.main import main
from estimator.config.schema import Ward
from estimator.demo.ward import free_port
from estimator.web.serve import Server
from tests.web.asking import PASSWORD, PEOPLE
from tests.web.talk import WARD

URL = "http://127.0.0.1:8090"
HASH = PasswordHasher(time_cost=1, memory_cost=64).hash(PASSWORD)
FILE = f"""ward = "{WARD}"

[dashboard]
session_hours = 4.0   # a shift

[[dashboard.people]]
name = "chief"        # the engineer
role = "administrator"
password = "{HASH}"

[[dashboard.people]]
name = "nurse"
password = "{PEOPLE[0].password}"

[alerts]
hold_s = {{ lost = 60 }}
"""


class Page:
    """A browser on the pages of a ward whose file may change."""

    def __init__(self, server: Server) -> None:
        self._client = TestClient(server.app, base_url=URL, follow_redirects=False)
        self.get = self._client.get

    def log_in(self, name: str, password: str = PASSWORD) -> int:
        return self._client.post("/login", data={"name": name, "password": password}).status_code

    def post(self, path: str, **fields: str) -> tuple[int, str]:
        csrf = re.search(r'name="csrf" value="([^"]+)"', self.get("/").text)
        answer = self._client.post(path, data={"csrf": csrf[1] if csrf else "", **fields})
        return answer.status_code, answer.text


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "ward.toml"
    made.write_text(FILE, "utf-8")
    made.chmod(0o640)
    return made


@pytest.fixture
def another(path: Path) -> Iterator[Callable[[], Page]]:
    """Opens one more browser on the same dashboard."""
    server = Server(WARD, load(path, Ward).dashboard, people=path)
    with TestClient(server.app, base_url=URL):
        yield lambda: Page(server)


def roles(path: Path) -> dict[str, str]:
    return {one.name: one.role for one in load(path, Ward).dashboard.people}


def test_an_administrator_adds_a_person_who_chooses_a_password_once(path: Path, another: Callable[[], Page]) -> None:
    chief, joy = another(), another()
    assert chief.log_in("chief") == 303
    assert 'href="/people"' in chief.get("/").text
    code, page = chief.post("/people", do="add", name="joy", role="operator")
    found = re.search(r'<code id="link">http://127.0.0.1:8090(/welcome\?key=(\S+))</code>', page)
    assert code == 200
    assert found is not None
    assert "joy" in joy.get(found[1]).text
    assert joy.post("/welcome", key=found[2], password="too short", again="too short")[0] == 400
    assert joy.post("/welcome", key=found[2], password="long enough", again="long enough!")[0] == 400
    assert joy.post("/welcome", key=found[2], password="long enough", again="long enough")[0] == 303
    assert joy.post("/welcome", key=found[2], password="once more, please", again="once more, please")[0] == 404
    assert joy.log_in("joy", "long enough") == 303
    assert roles(path) == {"chief": "administrator", "nurse": "operator", "joy": "operator"}
    text = path.read_text("utf-8")
    assert text.startswith(FILE.replace('name = "chief"        # the engineer', 'name = "chief"        # the engineer'))
    assert "long enough" not in text
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_changed_person_logs_in_again_and_a_removed_one_never(path: Path, another: Callable[[], Page]) -> None:
    chief, nurse = another(), another()
    assert (chief.log_in("chief"), nurse.log_in("nurse")) == (303, 303)
    assert chief.post("/people", do="role", name="nurse", role="administrator")[0] == 303
    assert nurse.get("/people").status_code == 401, "her session ended"
    assert nurse.log_in("nurse") == 303
    assert nurse.get("/people").status_code == 200
    assert nurse.post("/people", do="remove", name="chief")[0] == 303
    assert chief.log_in("chief") == 401
    assert roles(path) == {"nurse": "administrator"}
    assert "# a shift" in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"do": "remove", "name": "chief"}, 409),
        ({"do": "role", "name": "chief", "role": "operator"}, 409),
        ({"do": "add", "name": "nurse", "role": "operator"}, 409),
        ({"do": "remove", "name": "nobody"}, 409),
        ({"do": "add", "name": "Nurse Joy", "role": "operator"}, 400),
        ({"do": "add", "name": "joy", "role": "king"}, 400),
        ({"do": "promote", "name": "nurse"}, 400),
        ({"do": "remove", "name": "nurse", "csrf": "another"}, 403),
    ],
)
def test_what_is_refused_changes_nothing(
    path: Path, another: Callable[[], Page], fields: dict[str, str], code: int
) -> None:
    chief = another()
    chief.log_in("chief")
    assert chief.post("/people", **fields)[0] == code
    assert path.read_text("utf-8") == FILE


def test_only_an_administrator_may(path: Path, another: Callable[[], Page]) -> None:
    for page, code in ((another(), 401), (nurse := another(), 403)):
        if page is nurse:
            assert nurse.log_in("nurse") == 303
        assert page.get("/people").status_code == code
        assert page.post("/people", do="remove", name="nurse")[0] == code
        assert "/people" not in page.get("/").text
        assert page.get("/welcome?key=guessed").status_code == 404
    assert path.read_text("utf-8") == FILE


def test_a_file_that_cannot_be_written_is_named(path: Path, another: Callable[[], Page]) -> None:
    chief = another()
    chief.log_in("chief")
    path.write_text("a hand is editing this")
    code, page = chief.post("/people", do="remove", name="nurse")
    assert code == 503
    assert str(path) in page
    assert path.read_text() == "a hand is editing this"


def typed(monkeypatch: pytest.MonkeyPatch, path: Path, words: str, password: str = "") -> int:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{password}\n"))
    return main(["people", *words.split(), "--config", str(path)])


def test_commands_change_the_file_in_place(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(monkeypatch, path, "add joy --administrator", "long enough") == 0
    assert typed(monkeypatch, path, "role nurse administrator") == 0
    assert typed(monkeypatch, path, "remove chief") == 0
    assert typed(monkeypatch, path, "list") == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "nurse                administrator",
        "joy                  administrator",
    ]
    before = path.read_text("utf-8")
    assert typed(monkeypatch, path, "password joy", "a new password") == 0
    changed = [
        now for now, then in zip(path.read_text("utf-8").splitlines(), before.splitlines(), strict=True) if now != then
    ]
    assert [line.split(" ")[0] for line in changed] == ["password"]
    for words, password, said in (
        ("add joy", "long enough", "joy is listed already"),
        ("add Joy", "long enough", "NAME 'Joy' is not valid"),
        ("add ann", "short", "use at least 10"),
        ("remove ann", "", "unknown person 'ann'; known are: nurse, joy"),
    ):
        assert typed(monkeypatch, path, words, password) == 2
        assert said in capsys.readouterr().err


def test_a_running_dashboard_takes_a_new_person_from_the_people_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port, people = free_port(), tmp_path / "people.toml"
    path = tmp_path / "ward.toml"
    path.write_text(f'ward = "w"\n[dashboard]\nlisten = "127.0.0.1:{port}"\npeople_file = "{people}"\n')
    assert typed(monkeypatch, path, "add nurse", PASSWORD) == 0
    assert people.stat().st_mode & 0o777 == 0o600
    words = [sys.executable, "-m", "estimator.cli.main", "dashboard", "--config", str(path)]
    with subprocess.Popen(words, stderr=subprocess.DEVNULL) as dashboard:
        try:
            assert until(lambda: let_in(port, "nurse", PASSWORD))
            assert typed(monkeypatch, path, "add script --token") == 0
            token = capsys.readouterr().err.split(" ")[-1].strip()
            assert until(lambda: let_in(port, *token.split(".", 1)))
        finally:
            dashboard.terminate()


def let_in(port: int, name: str, password: str) -> bool:
    form = urllib.parse.urlencode({"name": name, "password": password, "to": "/api/v1/devices"}).encode()
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/login", form) as answer:
            return bool(answer.status == 200)
    except urllib.error.URLError:
        return False


def until(met: Callable[[], bool], seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while not (there := met()) and time.monotonic() < end:
        time.sleep(0.3)
    return there
