"""A router that goes and comes is said once each."""

import logging

import pytest

from bridge.bus.router_watch import RouterWatch

log = logging.getLogger("here")


def told(caplog: pytest.LogCaptureFixture, looks: list[tuple[float, bool]]) -> tuple[list[bool], list[str]]:
    caplog.set_level(logging.INFO)
    watched = RouterWatch(log)
    away = [watched.look(now, connected=connected) for now, connected in looks]
    return away, caplog.messages


def test_a_router_that_goes_and_comes_is_said_once_each(caplog: pytest.LogCaptureFixture) -> None:
    away, said = told(caplog, [(0, True), (1, False), (2, False), (3, True), (4, True)])
    assert away == [False, True, True, True, False]
    assert said == ["the router is gone; waiting for it to return", "the router is connected again"]
