"""Who may, and how often somebody may try: with time as an argument."""

import pytest

from estimator.web.client_address import neighbourhood
from estimator.web.login_attempts import ADDRESS_FREE, FORGET_S, FREE, NAME_FREE, Attempts
from estimator.web.sessions import SESSIONS, Sessions


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
