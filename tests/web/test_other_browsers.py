"""Ward page, device page and guide in Firefox and WebKit: each opens, follows the ward, and no script of it fails."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridge.wire.messages import State
from tests.estimator.stream import NAME
from tests.web import talk
from tests.web.conftest import Site
from tests.web.other_browsers import Firefox, WebKit
from tests.web.played import Played
from tests.web.talk import said
from tests.web.test_browser import now_ns, rates, ward
from tests.web.test_guide import DONE, PLACE, rests_between, turn

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.timeout(300)]


@pytest.fixture(params=[Firefox, WebKit])
def other(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Firefox | WebKit]:
    if not request.param.there():
        pytest.skip(f"{request.param.__name__} is not here; `apt-get install {request.param.needs}` brings it")
    made = request.param(tmp_path)
    yield made
    made.close()


def until(browser: Firefox | WebKit, expression: str, wanted: Any) -> None:
    """Until an expression has this value."""
    end, found = time.monotonic() + 60, None
    while time.monotonic() < end:
        if (found := browser.evaluate(expression)) == wanted:
            return
        time.sleep(0.1)
    raise AssertionError(f"{expression} is {found!r}, not {wanted!r}")


def text(selector: str) -> str:
    return f"document.querySelector({selector!r})?.textContent.trim()"


def test_ward_device_and_guide(other: Firefox | WebKit, site: Site) -> None:
    names = ward(site, 6)
    other.goto(f"{site.url}/?lang=en")
    until(other, text("h1"), "6 of 6 tracking")
    site.talk(said(names[0], State.DEGRADED, boot=5, time_ns=now_ns()))
    until(other, text("h1"), "5 of 6 tracking")
    assert other.evaluate("document.querySelectorAll('.tile').length") == 6
    assert other.evaluate("document.documentElement.scrollWidth <= innerWidth")
    other.goto(f"{site.url}/devices/{names[1]}#signals")
    until(other, "document.getElementById('signals').open", wanted=True)
    drawn = """[...document.querySelectorAll("#rates canvas")].some((canvas) =>
      canvas.width && canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value))"""
    for k in range(100):
        rates(site, names[1], 0.5, 0.5 * k)
        time.sleep(0.1)
        if other.evaluate(drawn):
            break
    assert other.evaluate(drawn)
    played = Played(site.talk)
    played.switch_on(rests_between(turn(2), turn(0), turn(1)))
    talk.until(lambda: NAME in site.server.desk.known.stories)
    other.goto(f"{site.url}/devices/{NAME}/calibrate")
    until(other, text("#do"), PLACE)
    played.play_piece(0)
    until(other, text("#do"), "Turn it round once, flat on the table")
    played.play_piece(6)
    until(other, text("#do"), DONE)
    assert [one for one in other.errors() if "WebSocket" not in one] == []
