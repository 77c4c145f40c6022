"""What a guesser, a flood, a slow client and a mistyped request get, and that nobody else pays for it."""

import logging
import socket
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from bridge.wire.messages import Note
from estimator.config.dashboard import Dashboard
from estimator.config.schema import Ward
from estimator.service.store import Store
from estimator.web import hub, listener, live
from estimator.web.live import WISH_S, WISHES, Pace
from estimator.web.login_attempts import FREE
from estimator.web.serve import Server
from estimator.web.ward_state import CALIBRATIONS
from tests.estimator.device.test_correction import CALIBRATION
from tests.web.asking import BEARER, LIVE, PASSWORD, PEOPLE, SCRIPT, URL, Asking, error
from tests.web.conftest import Site, served
from tests.web.talk import WARD, said, until

RIGHT = {"name": "nurse", "password": PASSWORD}


# ---- passwords ----------------------------------------------------------------------------------------------------------


def test_right_tokens_between_do_not_let_one_guess_for_ever(asking: Asking) -> None:
    wrong = []
    for _ in range(3):
        wrong += [asking.client.post("/login", data={**RIGHT, "password": "wrong"}).status_code for _ in range(4)]
        token = {"Authorization": "Bearer script.a token of its own"}
        assert asking.client.post("/api/v1/devices/chest/cancel", headers=token).status_code == 200
    assert wrong == [401] * FREE + [429] * (12 - FREE)


def test_a_new_login_ends_the_old_session_of_that_browser(asking: Asking) -> None:
    csrf = asking.log_in()
    old = {"Cookie": f"truerate={asking.client.cookies['truerate']}"}
    asking.log_in()
    asking.client.cookies.clear()
    assert asking.client.post("/devices/chest/cancel", data={"csrf": csrf}, headers=old).status_code == 401


def test_under_tls_no_other_host_can_set_the_cookie(asking: Asking) -> None:
    with TestClient(asking.server.app, base_url=URL.replace("http", "https"), follow_redirects=False) as client:
        cookie = client.post("/login", data=RIGHT).headers["set-cookie"]
        assert cookie.startswith("__Host-truerate=")
        assert all(word in cookie.lower() for word in ("; secure", "; path=/", "; httponly"))
        assert "domain" not in cookie.lower()
        assert ">nurse<" in client.get("/").text
        value = client.cookies["__Host-truerate"]
        client.cookies.clear()
        assert ">nurse<" not in client.get("/", headers={"Cookie": f"truerate={value}"}).text


# ---- hosts and origins --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "http://[::1", "http://[", "https://127.0.0.1:8090", "http://127.0.0.1:8090/x", "null", ""],
)
def test_an_origin_that_is_not_ours_is_refused_whatever_it_looks_like(asking: Asking, origin: str) -> None:
    answer = asking.client.post("/login", data=RIGHT, headers={"Origin": origin})
    assert answer.status_code == 403
    assert answer.headers["content-security-policy"].startswith("default-src 'self';")
    assert ("behind_proxy" in answer.text) == origin.startswith("https")
    programs = asking.client.post("/api/v1/devices/chest/cancel", headers={**BEARER, "Origin": origin})
    assert error(programs) == (403, "foreign_origin")
    with pytest.raises(WebSocketDisconnect), asking.client.websocket_connect(LIVE, headers={"Origin": origin}):
        pass


def test_a_form_that_another_site_sends_is_refused(asking: Asking) -> None:
    for site, code in (("cross-site", 403), ("same-site", 403), ("same-origin", 303)):
        assert asking.client.post("/login", data=RIGHT, headers={"Sec-Fetch-Site": site}).status_code == code
    for host in ("localhost:1", "[::1]:8090"):
        assert asking.client.get("/", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["x@localhost", "1.2.3.4:99999", "localhost/x", "localhost?x", "[::1", "", "1.2.3.4:x", "evil.example"]
)
def test_a_host_that_is_none_is_refused(asking: Asking, host: str) -> None:
    assert asking.client.get("/", headers={"Host": host}).status_code == 400
    assert error(asking.client.get("/api/v1/devices", headers={"Host": host})) == (400, "foreign_host")


def test_a_proxy_says_who_asks_and_how() -> None:
    site = served(behind_proxy=True)
    host = site.url.removeprefix("http://")
    body = f"name=nurse&password={PASSWORD.replace(' ', '+')}"
    head = f"POST /login HTTP/1.1\r\nHost: {host}\r\nOrigin: https://{host}\r\nContent-Length: {len(body)}\r\n"
    head += "Content-Type: application/x-www-form-urlencoded\r\n"
    assert said_to(site, f"{head}\r\n{body}").startswith("HTTP/1.1 403")
    answer = said_to(site, f"{head}X-Forwarded-Proto: https\r\nX-Forwarded-For: 10.0.0.7\r\n\r\n{body}")
    assert answer.startswith("HTTP/1.1 303")
    assert "set-cookie: __Host-truerate=" in answer
    site.stop()


# ---- viewers ------------------------------------------------------------------------------------------------------------


def test_so_many_viewers_from_one_address_and_a_further_one_is_told(
    asking: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub, "OF_ONE_ADDRESS", 2)
    with asking.client.websocket_connect(LIVE) as first, asking.client.websocket_connect(LIVE) as second:
        for socket_ in (first, second):
            socket_.send_text('{"watch": ["ward"]}')
            assert socket_.receive_json()["topic"] == "ward"
        with asking.client.websocket_connect(LIVE) as third, pytest.raises(WebSocketDisconnect) as gone:
            third.receive_text()
        assert (gone.value.code, gone.value.reason) == (
            1013,
            "2 pages are open already from testclient; this page tries again",
        )
    with asking.client.websocket_connect(LIVE) as later:
        later.send_text('{"watch": ["ward"]}')
        assert later.receive_json()["topic"] == "ward"


def test_who_does_not_say_what_it_watches_is_let_go(asking: Asking, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "FIRST_S", 0.05)
    with asking.client.websocket_connect(LIVE) as silent:
        with pytest.raises(WebSocketDisconnect) as gone:
            silent.receive_text()
        assert gone.value.code == 1008


def test_wishes_have_a_pace() -> None:
    pace = Pace()
    assert [pace.wait_s(100.0) for _ in range(WISHES)] == [0.0] * WISHES
    assert pace.wait_s(100.0) == pytest.approx(WISH_S)
    assert pace.wait_s(100.0 + WISH_S) == pytest.approx(WISH_S)
    assert pace.wait_s(200.0) == 0.0


# ---- connections --------------------------------------------------------------------------------------------------------


def connected(site: Site) -> socket.socket:
    made = socket.create_connection(("127.0.0.1", int(site.url.rpartition(":")[2])))
    made.settimeout(20)
    return made


def all_of(made: socket.socket) -> str:
    """What comes until the other side closes."""
    found = b""
    try:
        while part := made.recv(65536):
            found += part
    except ConnectionResetError:
        pass
    return found.decode("latin-1")


def said_to(site: Site, request: str) -> str:
    with closing(connected(site)) as made:
        made.sendall(request.replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n", 1).encode())
        return all_of(made)


HEAD = "POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n"


@pytest.mark.parametrize(
    ("begun", "answered"),
    [
        ("", ""),
        ("GET / HTTP/1.1\r\nHost: localhost\r\nX: ", ""),
        (HEAD + "\r\nname=", ""),
        ("GET /login HTTP/1.1\r\nHost: localhost\r\n\r\nGET / HT", "HTTP/1.1 200"),
        ("GET /static/ward.css HTTP/1.1\r\nHost: localhost\r\n\r\nGET /", "HTTP/1.1 200"),
    ],
)
def test_who_does_not_end_a_request_is_let_go(
    site: Site, monkeypatch: pytest.MonkeyPatch, begun: str, answered: str
) -> None:
    monkeypatch.setattr(listener, "WHOLE_S", 0.2)
    with closing(connected(site)) as slow:
        slow.sendall(begun.encode())
        assert all_of(slow)[: len("HTTP/1.1 200")] == answered
    assert site.server.uvicorn.refused.as_dict() == {"too slow": 1}


def test_who_does_not_read_the_answer_is_let_go(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "WHOLE_S", 0.2)
    with closing(socket.socket()) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        deaf.connect(("127.0.0.1", int(site.url.rpartition(":")[2])))
        deaf.setblocking(False)
        request = b"GET /static/charts.js HTTP/1.1\r\nHost: localhost\r\n\r\n"
        while not site.server.uvicorn.refused.as_dict():
            try:
                deaf.send(request)
            except (BlockingIOError, ConnectionError):
                time.sleep(0.01)
    until(lambda: not site.server.uvicorn.server_state.connections)


def test_a_client_that_is_gone_leaves_no_traceback(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    state = site.server.uvicorn.server_state
    with caplog.at_level(logging.INFO):
        with closing(connected(site)) as gone:
            gone.sendall(HEAD.encode() + b"\r\nname=")
            until(lambda: state.tasks)
        until(lambda: not (state.tasks or state.connections))
    assert [record for record in caplog.records if record.exc_info] == []


def test_one_address_has_so_many_connections_and_is_told(
    site: Site, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(listener, "OF_ONE_ADDRESS", 3)
    many = [connected(site) for _ in range(3)]
    for _ in range(2):
        with closing(connected(site)) as more:
            assert all_of(more).startswith("HTTP/1.1 503 ")
    assert caplog.text.count("a connection is refused: 3 connections are open from 127.0.0.1") == 1
    for one in many:
        one.close()
    until(lambda: not site.server.uvicorn.server_state.connections)
    assert said_to(site, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").startswith("HTTP/1.1 200")


# ---- programs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("devices?colour=red", (400, "unknown_parameter")),
        ("devices/chest?colour=x", (400, "unknown_parameter")),
        ("devices/chest/calibrations?colour=x", (400, "unknown_parameter")),
        ("devices/chest/calibrations?limit=0", (400, "bad_parameter")),
        ("devices/chest/calibrations?limit=501", (400, "bad_parameter")),
        ("devices/chest/calibrations?limit=x", (400, "bad_parameter")),
        ("devices/chest/calibrations?before=x", (404, "unknown_calibration")),
        ("openapi.json?x", (400, "unknown_parameter")),
        ("devices/", (404, "not_found")),
        ("devices/chest/", (404, "not_found")),
        ("", (404, "not_found")),
    ],
)
def test_what_is_mistyped_is_said(asking: Asking, path: str, expected: tuple[int, str]) -> None:
    answer = asking.client.get(f"/api/v1/{path}")
    assert error(answer) == expected
    assert answer.headers["content-type"] == "application/json"


def test_what_fails_here_is_said_as_everything_else(asking: Asking, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asking.server.desk.known, "rows", lambda now: 1 / 0)
    monkeypatch.setattr("estimator.web.pages.ward_page", lambda *_: 1 / 0)
    client = TestClient(asking.server.app, base_url=URL, raise_server_exceptions=False)
    for path in ("/api/v1/devices", "/"):
        answer = client.get(path)
        assert answer.status_code == 500
        assert answer.headers["content-security-policy"].startswith("default-src 'self';")
        assert answer.headers["cache-control"] == "no-store"
        assert "dashboard&#39;s log" in answer.text or error(answer) == (500, "failed")


def test_old_calibrations_have_certificates_and_push_nothing_out(tmp_path: Path) -> None:
    ids = [f"c{i:03}" for i in range(4 * CALIBRATIONS)]
    store = Store(tmp_path / "ward.sqlite3")
    for i, name in enumerate(ids):
        store.add_calibration(replace(CALIBRATION, device="chest", boot=5, id=name, time_ns=10**18 + i * 10**9))
    store.close()
    server = Server(WARD, Dashboard(people=PEOPLE), tmp_path / "ward.sqlite3")
    known = server.desk.known
    known.take_status(said("chest", boot=5, calibration=ids[100]), 0.0)
    known.take_note(Note("chest", 5, 2 * 10**18, "nurse", "sat up"))
    with TestClient(server.app, base_url=URL) as client:
        for name in (ids[2], ids[100]):
            answer = client.get(f"/devices/chest/calibrations/{name}/certificate")
            assert answer.status_code == 200
            assert "There is no earlier calibration to compare it with." not in answer.text
        assert client.get("/devices/chest").status_code == 200
        for path in ("/devices/nobody/calibrations/x/certificate", "/api/v1/devices/nobody/calibrations"):
            assert client.get(path).status_code == 404
    assert list(known.stories) == ["chest"], "of who is nobody nothing is kept"
    story = known.stories["chest"]
    assert list(story.calibrations) == [ids[100], *ids[-CALIBRATIONS:]]
    assert len(story.trail.marks) == 2 + CALIBRATIONS
    assert story.trail.marks[0].kind == "note"


def test_all_calibrations_can_be_had_page_by_page(tmp_path: Path) -> None:
    ids = [f"c{i:03}" for i in range(CALIBRATIONS + 20)]
    store = Store(tmp_path / "ward.sqlite3")
    for i, name in enumerate(ids):
        store.add_calibration(replace(CALIBRATION, device="chest", boot=5, id=name, time_ns=10**18 + i, who=""))
    store.close()
    server = Server(WARD, Dashboard(people=PEOPLE), tmp_path / "ward.sqlite3")
    server.desk.known.take_status(said("chest", boot=5), 0.0)
    with TestClient(server.app, base_url=URL) as client:
        place = "/api/v1/devices/chest/calibrations"
        whole = client.get(place, params={"limit": 500}).json()
        assert ([one["id"] for one in whole["calibrations"]], whole["next"]) == (ids[::-1], None)
        assert whole["calibrations"][0]["who"] is None
        found: list[str] = []
        before: dict[str, str] = {}
        for _ in range(4):
            page = client.get(place, params={"limit": "20", **before}).json()
            found += [one["id"] for one in page["calibrations"]]
            before = {"before": page["next"]}
        assert (found, page["next"]) == (ids[::-1], None)
        assert len(client.get(place).json()["calibrations"]) == 50


def test_changed_people_hosts_and_limits_take_effect_at_once(asking: Asking) -> None:
    asking.log_in()
    asking.server.use(Ward(ward=WARD, dashboard=Dashboard(people=(*PEOPLE, SCRIPT), hosts=("ward-3.example",))))
    assert 'name="csrf"' in asking.client.get("/").text, "she is still one of them"
    assert asking.client.get("/", headers={"Host": "ward-3.example"}).status_code == 200
    asking.server.use(Ward(ward=WARD, dashboard=Dashboard(people=(SCRIPT,))))
    assert 'name="csrf"' not in asking.client.get("/").text, "her session ended with her name"
    assert asking.client.get("/", headers={"Host": "ward-3.example"}).status_code == 400
    refused = asking.client.post("/login", data={"name": "nurse", "password": PASSWORD, "to": "/"})
    assert refused.status_code == 401
