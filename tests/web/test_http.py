"""What is answered over HTTP: to pages, to programs, and to those who may not."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.websockets import WebSocketDisconnect

from bridge.reasons.catalogue import sentences_as_json
from bridge.wire.messages import Alert, CommandReply, Placement
from estimator.offline import calibration_file
from estimator.web.login_attempts import FREE
from tests.estimator.device.test_correction import CALIBRATION
from tests.sentences import free
from tests.web.asking import BEARER, LIVE, PASSWORD, URL, Asking, error
from tests.web.talk import WARD, about, said


def test_every_answer_binds_the_browser(asking: Asking) -> None:
    for path in ("/", "/login", "/nothing", "/api/v1/devices", "/static/ward.css"):
        headers = asking.client.get(path).headers
        assert headers["content-security-policy"].startswith("default-src 'self';")
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    assert asking.client.get("/").headers["cache-control"] == "no-store"
    page = asking.client.get("/").text + asking.client.get("/devices/chest").text
    assert not re.search(r"<script(?![^>]*src=)[^>]*>|\sstyle=|\son\w+=", page)


def test_a_command_goes_back_to_where_it_was_given_but_never_elsewhere(asking: Asking) -> None:
    csrf = asking.log_in()
    for to, place in (
        ("/devices/chest/calibrate", "/devices/chest/calibrate"),
        ("//evil.example", "/"),
        ("https://evil.example", "/"),
    ):
        answer = asking.client.post("/devices/chest/cancel", data={"csrf": csrf, "to": to})
        assert answer.headers["location"] == place


def test_the_guide_binds_the_browser_too_and_keeps_a_language(asking: Asking) -> None:
    page = asking.client.get("/devices/chest/calibrate", headers={"Accept-Language": "zh-CN,en;q=0.5"})
    assert '<html lang="zh">' in page.text
    assert not re.search(r"<script(?![^>]*src=)[^>]*>|\sstyle=|\son\w+=", page.text)
    assert asking.client.get("/devices/nobody/calibrate").status_code == 404
    assert '<html lang="en">' in asking.client.get("/report?lang=en").text
    assert '<html lang="en">' in asking.client.get("/report", headers={"Accept-Language": "zh"}).text
    assert '<html lang="en">' in asking.client.get("/report?lang=../../x").text


def test_a_session_is_needed_and_its_own_page(asking: Asking) -> None:
    path = "/devices/chest/recalibrate"
    assert asking.client.post(path, data={"csrf": ""}).status_code == 401
    csrf = asking.log_in()
    assert asking.client.post(path, data={"csrf": "wrong"}).status_code == 403
    assert asking.client.post(path, data={}).status_code == 403
    assert asking.talk.asked == []
    assert asking.client.post(path, data={"csrf": csrf, "words": "new battery"}).headers["location"] == "/devices/chest"
    assert asking.talk.asked == [("chest", "recalibrate", "nurse", "new battery")]
    assert "chest: recalibrate it is" in asking.client.get("/devices/chest").text
    assert "recalibrate it is" not in asking.client.get("/devices/chest").text
    assert asking.client.post("/logout", data={"csrf": csrf}).status_code == 303
    assert asking.client.post(path, data={"csrf": csrf}).status_code == 401


def test_the_cookie_is_for_the_server_alone(asking: Asking) -> None:
    answer = asking.client.post("/login", data={"name": "nurse", "password": PASSWORD, "to": "//evil.example"})
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert "secure" not in cookie  # without TLS no browser would send it back
    assert answer.headers["location"] == "/"
    again = asking.client.post(URL.replace("http", "https") + "/login", data={"name": "nurse", "password": PASSWORD})
    assert "secure" in again.headers["set-cookie"].lower()


def test_passwords_cannot_be_tried_for_ever(asking: Asking) -> None:
    for data in ({}, {"name": "nurse"}, {"password": PASSWORD}):
        assert asking.client.post("/login", data=data).status_code == 400, "nothing was tried"
    assert asking.client.post("/login", data={"name": "x" * 5000, "password": "wrong"}).status_code == 401
    for _ in range(FREE):
        answer = asking.client.post("/login", data={"name": "nurse", "password": "wrong"})
        assert answer.status_code == 401
        assert "The name or the password is wrong." in answer.text
    late = asking.client.post("/login", data={"name": "nurse", "password": PASSWORD})
    assert late.status_code == 429
    assert 0 < int(late.headers["retry-after"]) <= 30
    assert error(asking.client.post("/api/v1/devices/chest/cancel", headers=BEARER)) == (429, "too_many_tries")


def test_a_note_that_nobody_took_is_not_lost(asking: Asking) -> None:
    csrf = asking.log_in()
    asking.talk.close()
    answer = asking.client.post("/devices/chest/note", data={"csrf": csrf, "words": "sat up <b>"})
    assert answer.headers["location"] == "/devices/chest"
    page = asking.client.get("/devices/chest").text
    assert "The estimator does not answer: nothing was done." in page
    assert 'value="sat up &lt;b&gt;"' in page
    assert "sat up" not in asking.client.get("/devices/chest").text
    assert error(asking.client.post("/api/v1/devices/chest/recalibrate", headers=BEARER)) == (503, "no_answer")


def test_programs_get_what_people_see(asking: Asking) -> None:
    asking.hear(replace(CALIBRATION, device="chest", boot=5), said("wrist", boot=6, time_ns=time.time_ns()))
    found = asking.client.get("/api/v1/devices").json()
    assert (found["ward"], found["of"], found["tracking"], found["connected"]) == (WARD, 2, 2, True)
    assert [device["id"] for device in found["devices"]] == ["chest", "wrist"]
    assert asking.client.get("/api/v1/devices/chest").json() == next(d for d in found["devices"] if d["id"] == "chest")


def test_a_calibration_is_a_file_that_can_be_used(asking: Asking, tmp_path: Path) -> None:
    asking.talk(replace(CALIBRATION, device="chest", boot=5))
    while not (found := asking.client.get("/api/v1/devices/chest/calibrations").json()["calibrations"]):
        time.sleep(0.02)
    assert found[0]["in_use"]
    (tmp_path / "chest.json").write_text(json.dumps(found[0]))
    loaded = calibration_file.load(tmp_path / "chest.json")
    assert loaded.matrix == pytest.approx(CALIBRATION.matrix)


def test_commands_of_programs(asking: Asking) -> None:
    client, place = asking.client, "/api/v1/devices/chest/note"
    done = client.post(place, headers=BEARER, json={"words": "sat up"})
    assert (done.status_code, done.json()) == (
        200,
        {"accepted": True, "message": sentences_as_json(free("note it is"))},
    )
    assert asking.talk.asked == [("chest", "note", "nurse", "sat up")]
    asking.talk.answer = lambda verb, device: CommandReply(
        "", accepted=False, message=free("no calibration is under way")
    )
    refused = client.post("/api/v1/devices/chest/cancel", headers=BEARER)
    assert refused.json() == {
        "error": {
            "code": "not_accepted",
            "message": "no calibration is under way",
            "reason": sentences_as_json(free("no calibration is under way")),
        }
    }
    assert refused.status_code == 409
    csrf = asking.log_in()
    assert client.post(place, headers={"X-CSRF-Token": csrf}, json={"words": "x"}).status_code == 409
    assert error(client.post(place, json={"words": "x"})) == (403, "stale_page")


def test_a_placement_is_set_by_page_and_program_and_shown_to_both(asking: Asking) -> None:
    client, csrf = asking.client, asking.log_in()
    form = {"csrf": csrf, "segment": "humerus", "side": "left", "wearer": " bed-3"}
    assert client.post("/devices/chest/place", data=form).headers["location"] == "/devices/chest"
    assert client.post("/api/v1/devices/chest/place", headers=BEARER, json={"wearer": "P07"}).status_code == 200
    assert client.post("/api/v1/devices/chest/place", headers=BEARER).status_code == 200
    assert asking.talk.placed == [Placement("humerus", "left", "bed-3"), Placement(wearer="P07"), Placement()]
    client.post("/devices/chest/place", data={"csrf": csrf, "segment": "torso", "side": "left"})
    assert "Only arms and legs have a side" in client.get("/devices/chest").text
    assert len(asking.talk.placed) == 3
    asking.hear(about("arm"), said("arm", boot=5, placement=Placement("humerus", "left", "bed-3", 10**18, "anna")))
    assert "左上臂 · bed-3" in client.get("/?lang=zh").text
    for page in ("/?lang=en", "/devices/arm", "/report"):
        assert "upper arm, left · bed-3" in client.get(page).text
    told = {
        "segment": "humerus",
        "side": "left",
        "wearer": "bed-3",
        "since": "2001-09-09T01:46:40.000+00:00",
        "who": "anna",
    }
    assert client.get("/api/v1/devices/arm").json()["placement"] == told


def test_an_alert_is_shown_and_acknowledged_by_page_and_program(asking: Asking) -> None:
    client, csrf = asking.client, asking.log_in()
    alerts = (Alert("lost", 10**18, 10**18 + 1), Alert("degraded", 10**18, 10**18 + 2, 10**18 + 3, "bo"))
    asking.hear(about("arm"), said("arm", boot=5, alerts=alerts, placement=Placement(wearer="bed-3")))
    page = client.get("/?lang=en").text
    assert "arm (bed-3): no contact." in page
    assert "Seen by bo" in page
    told = client.get("/api/v1/alerts").json()["alerts"]
    assert [(one["subject"], one["kind"], one["who"]) for one in told] == [
        ("arm", "lost", ""),
        ("arm", "degraded", "bo"),
    ]
    form = {"csrf": csrf, "words": "lost", "to": "/"}
    answer = client.post("/devices/arm/acknowledge", data=form)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    place = "/api/v1/alerts/one/acknowledge"
    assert client.post(place, headers=BEARER, json={"words": "disk"}).status_code == 200
    assert asking.talk.asked == [
        ("arm", "acknowledge", "nurse", "lost"),
        ("one", "acknowledge", "nurse", "disk"),
    ]
    assert client.post("/devices/arm/acknowledge", data={**form, "csrf": ""}).status_code == 403
    assert client.post("/devices/A b/acknowledge", data=form).status_code == 404


@pytest.mark.parametrize(
    ("path", "body", "kind", "expected"),
    [
        ("chest/place", b'{"segment":"arm"}', "application/json", (400, "bad_body")),
        ("chest/place", b'{"wearer":"  "}', "application/json", (409, "bad_placement")),
        ("chest/place", b'{"segment":"torso","side":"left"}', "application/json", (409, "bad_placement")),
        ("CHEST/note", b'{"words":"x"}', "application/json", (400, "bad_id")),
        ("nobody/note", b'{"words":"x"}', "application/json", (404, "unknown_device")),
        ("chest/note", b'{"words":"x"}', "text/plain", (415, "not_json")),
        ("chest/note", b'{"words":', "application/json", (400, "not_json")),
        ("chest/note", b"\xff\xfe", "application/json", (400, "not_json")),
        ("chest/note?only=x", b'{"words":"x"}', "application/json", (400, "unknown_parameter")),
        ("chest/note/", b'{"words":"x"}', "application/json", (404, "not_found")),
        ("chest/note", b'{"words":3}', "application/json", (400, "bad_body")),
        ("chest/note", b'{"word":"x"}', "application/json", (400, "bad_body")),
        ("chest/note", b'{"words":"a\\nb"}', "application/json", (400, "bad_text")),
        ("chest/note", b"", "application/json", (400, "bad_text")),
        ("chest/note", b'"' + b"x" * 20_000, "application/json", (413, "too_large")),
        ("chest/explode", b"", "application/json", (404, "not_found")),
    ],
)
def test_wrong_input_gets_a_clear_answer(
    asking: Asking, path: str, body: bytes, kind: str, expected: tuple[int, str]
) -> None:
    answer = asking.client.post(f"/api/v1/devices/{path}", content=body, headers={**BEARER, "Content-Type": kind})
    assert error(answer) == expected
    assert asking.talk.asked == []


def test_the_live_socket_gives_what_is_asked_and_nothing_else(asking: Asking) -> None:
    with asking.client.websocket_connect(LIVE, headers={"Origin": URL}) as socket:
        socket.send_text('{"watch": ["ward", "device/chest"]}')
        topics = {socket.receive_json()["topic"] for _ in range(2)}
        assert topics == {"ward", "device/chest"}
    for wish in (
        '{"watch": ["secrets"]}',
        '{"watch": ["device/CHEST"]}',
        '{"watch": ["ward/chest"]}',
        "{",
        '{"watch": 3}',
    ):
        with asking.client.websocket_connect(LIVE) as socket:
            socket.send_text(wish)
            with pytest.raises(WebSocketDisconnect) as gone:
                socket.receive_text()
            assert gone.value.code == 1007
