"""A router that goes and comes is said once each; who was held up says that it may be its own doing."""

import logging

import pytest

from bridge.bus.router_watch import RouterWatch

log = logging.getLogger("here")


def told(caplog: pytest.LogCaptureFixture, looks: list[tuple[float, bool]]) -> tuple[list[bool], list[str]]:
    caplog.set_level(logging.INFO)
    watched = RouterWatch(log, 1.0)
    away = [watched.look(now, connected=connected) for now, connected in looks]
    return away, caplog.messages


def test_a_router_that_goes_and_comes_is_said_once_each(caplog: pytest.LogCaptureFixture) -> None:
    away, said = told(caplog, [(0, True), (1, False), (2, False), (3, True), (4, True)])
    assert away == [False, True, True, True, False]
    assert said == ["the router is gone; waiting for it to return", "the router is connected again"]


def test_who_was_held_up_says_so(caplog: pytest.LogCaptureFixture) -> None:
    _, said = told(caplog, [(0, True), (4.5, True), (5.5, False), (6.5, True), (20.5, True), (21.5, True), (30, False)])
    assert "this program was stopped for 3.5 s because the machine is too busy" in said[0]
    assert "stopped for 7.5 s" in said[2]
