"""A calibration by hand with the page alone, in a real browser: a good one, a failed turn, a cancel, a reboot."""

import time
from math import radians

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from bridge.sim.motion import Piece, Still, Turn
from bridge.wire.messages import State
from tests.estimator.stream import NAME
from tests.web.asking import PASSWORD
from tests.web.conftest import Look, Site
from tests.web.played import Played
from tests.web.talk import said
from tests.web.test_browser import heard

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.timeout(300)]
PLACE, DONE = "Put it at the edge of the table, and let go", "Done: it is calibrated"
LISTEN = """window.heard = []; new MutationObserver(() => window.heard.push(document.getElementById("told").textContent))
  .observe(document.getElementById("told"), { childList: true, characterData: true, subtree: true })"""


def turn(axis: int, angle_deg: float = 360.0, duration_s: float = 4.0) -> Piece:
    return Turn(duration_s, np.eye(3)[axis], radians(angle_deg), np.array([[0.0, duration_s, 1.0]]))


def rests_between(*turns: Piece) -> list[Piece]:
    """Still, turn, still … still."""
    return [Still(4.5), *(piece for one in turns for piece in (one, Still(3.5)))]


def open_guide(page: Page, words: str = PLACE) -> None:
    page.goto(f"/devices/{NAME}/calibrate")
    while not page.locator(".guide").count():  # the dashboard has not heard of it yet
        page.wait_for_timeout(100)
        page.reload()
    expect(page.locator("#do")).to_have_text(words)


def log_in(page: Page) -> None:
    page.get_by_role("link", name="Log in to calibrate").click()
    page.get_by_label("Name").fill("nurse")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator(".guide")).to_be_visible()


@pytest.fixture
def played(site: Site) -> Played:
    return Played(site.talk)


def test_from_the_table_to_the_verdict_without_a_click(page: Page, played: Played, look: Look) -> None:
    def told(words: str) -> None:
        """The step is shown, and a moment later a screen reader says it."""
        expect(page.locator("#do")).to_have_text(words)
        expect(page.locator("#told")).to_contain_text(words)

    played.switch_on(rests_between(turn(2), turn(0, -360.0), turn(1)))
    played.play(1.0)
    open_guide(page)
    expect(page.locator("#log-in")).to_be_hidden()  # nothing can be cancelled yet
    page.evaluate(LISTEN)
    look("guide-place")
    played.play_piece(0)
    told("Turn it round once, flat on the table")
    expect(page.locator(".picture:visible")).to_have_attribute("data-picture", "flat")
    look("guide-turn-flat", axe=False)
    played.play_piece(1, 0.6)
    told("Go on, all the way round")
    expect(page.locator('#turns [data-mark="now"] .axis-name')).to_have_text("z")
    look("guide-turning", axe=False)
    # At arm's length all of it is on the screen of a phone, upright or on its side, and text of twice the size fits.
    for width, height in ((320, 568), (390, 740), (740, 360)):
        page.set_viewport_size({"width": width, "height": height})
        page.locator(".stage").evaluate("(stage) => stage.scrollIntoView()")
        box = page.locator("#ring").bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= height, (width, height, box)
    page.set_viewport_size({"width": 390, "height": 740})
    page.evaluate("document.documentElement.style.fontSize = '34px'")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.evaluate("document.documentElement.style.fontSize = ''")
    look()
    played.play_piece(2, 0.3)
    told("Now let go of it")
    look("guide-settle", axe=False)
    played.play_piece(2)
    told("Roll it over once, away from you")
    expect(page.locator("#log-in")).to_have_text("Log in to cancel it")
    expect(page.locator("#turns li")).to_have_text(["z flat, round done", "x over, away now", "y over, right to do"])
    look("guide-turn-along", axe=False)
    # It went the other way round than the arrow: both count, and the arrow follows.
    played.play_piece(3, 0.6)
    expect(page.locator('.picture:visible [data-way="-1"]')).to_be_visible()
    played.play_piece(4)
    told("Tip it to the right, all the way round")
    look("guide-turn-across", axe=False)
    played.play_piece(6)
    told(DONE)
    expect(page.locator("#turns li")).to_have_text(["z flat, round done", "x over, away done", "y over, right done"])
    expect(page.locator("#how")).to_have_text("Put it on the wearer. It stays calibrated until it is switched off.")
    expect(page.locator("#rows tr")).to_have_count(3)
    expect(page.locator("#compared")).to_have_text("There is no earlier calibration to compare it with.")
    look("guide-done")
    # No step is said twice in a row; steps that follow each other at once are said as the last of them.
    heard = page.evaluate("window.heard")
    assert [one for i, one in enumerate(heard) if i and one == heard[i - 1]] == []
    assert 6 <= len(heard) <= 16, heard  # a busy machine shows steps for longer, and then says more of them


def test_begun_and_cancelled_by_the_keyboard(page: Page, played: Played, look: Look) -> None:
    played.switch_on(rests_between(turn(2), turn(0), turn(1), Still(1.0), turn(2)))
    played.play_piece(6)
    open_guide(page, "It is calibrated")
    expect(page.locator("#rows tr")).to_have_count(3)
    expect(page.locator("#how")).to_contain_text("To calibrate it again, log in.")
    look("guide-idle", axe=False)
    log_in(page)
    expect(page.locator("#how")).to_have_text("It is ready: nothing to do.")
    page.get_by_role("button", name="Calibrate it again").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#do")).to_have_text(PLACE)
    expect(page.get_by_role("button", name="Calibrate it again")).to_be_hidden()
    played.play_piece(9, 0.6)
    expect(page.locator("#do")).to_have_text("Go on, all the way round")
    page.get_by_role("button", name="Cancel").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#do")).to_have_text("Cancelled")
    expect(page.locator("#how")).to_have_text("Put it on the wearer. The calibration it had before stays in use.")
    expect(page.locator("#wrong")).to_contain_text("nurse cancelled the calibration.")
    expect(page.get_by_role("button", name="Calibrate it again")).to_be_visible()
    expect(page.get_by_role("button", name="Cancel")).to_be_hidden()
    # What was answered is said by the step itself, and nothing of it tells that this worked.
    expect(page.locator("#said")).to_have_count(0)
    expect(page.locator(".guide")).to_have_attribute("data-tone", "ask")
    expect(page.locator(".picture:visible .good")).to_have_count(0)
    look("guide-cancelled")


def test_two_tablets_and_two_languages(page: Page, site: Site, browser: Browser, played: Played, look: Look) -> None:
    played.switch_on(rests_between(turn(2), turn(0, 180.0)))
    open_guide(page)
    other = browser.new_context(base_url=site.url, locale="zh-CN").new_page()
    other.goto(f"/devices/{NAME}/calibrate")
    expect(other.locator("#do")).to_have_text("把设备放在桌边，然后松手")
    played.play_piece(4)
    expect(page.locator("#do")).to_have_text("Again: roll it over once, away from you")
    expect(other.locator("#do")).to_have_text("再来一次：向前翻滚一整圈")
    expect(other.locator("#wrong")).to_contain_text("请转满一圈")
    other.get_by_role("link", name="English").click()
    expect(other.locator("#do")).to_have_text("Again: roll it over once, away from you")
    other.goto(f"/devices/{NAME}/calibrate")
    expect(other.locator("html")).to_have_attribute("lang", "en")
    other.context.close()
    page.get_by_role("link", name="中文").click()
    expect(page.locator("#do")).to_have_text("再来一次：向前翻滚一整圈")
    look("guide-failed-zh")
    page.goto(f"/devices/{NAME}?lang=en")
    expect(page.locator(".device > .advice")).to_have_text("Again: one whole turn. 1 of 3 turns are done.")
    expect(page.get_by_role("link", name="Go on, step by step")).to_be_visible()
    page.get_by_role("link", name="the whole ward").click()
    expect(page.locator(".tile .advice")).to_have_text("Again: one whole turn. 1 of 3 turns are done.")
    page.goto("/calibrate?lang=zh")
    expect(page.locator(".queued .wrong")).to_contain_text("请转满一圈")
    expect(page.locator(".queued .wrong")).not_to_contain_text("工程师")  # that is on the page of the device


def test_after_done_the_next_device_is_one_touch_away(page: Page, site: Site, played: Played, look: Look) -> None:
    played.switch_on(rests_between(turn(2), turn(0), turn(1)))
    for name, state in (("zz", State.AWAITING_STILL), ("yy", State.TRACKING)):
        site.talk(said(name, state, boot=1, time_ns=time.time_ns()))
    open_guide(page)
    expect(page.locator("#next")).to_be_hidden()
    played.play_piece(6)
    expect(page.locator("#do")).to_have_text(DONE)
    following = page.get_by_role("link", name="Next device: zz")
    expect(following).to_be_visible()
    look("guide-done-next")
    following.click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Calibrate zz")
    site.talk(said("zz", boot=1, time_ns=time.time_ns()))
    expect(page.locator("#next")).to_be_hidden()


def test_a_ward_is_calibrated_several_at_once(page: Page, site: Site, played: Played, look: Look) -> None:
    played.switch_on(rests_between(turn(2), turn(0), turn(1)))
    others = [f"d{n}" for n in range(7)]
    for name in others:
        site.talk(said(name, State.BIAS_ONLY, boot=1, time_ns=time.time_ns()))
    heard(site, 8)
    page.clock.install()
    page.goto("/calibrate")
    card = page.locator(f'.queued[data-id="{NAME}"]')
    expect(card.locator(".do")).to_have_text(PLACE)
    expect(page.locator(".queued")).to_have_count(6)
    expect(page.locator("#waiting")).to_have_text("Then: d5, d6")
    played.play_piece(1, 0.6)
    expect(card.locator(".do")).to_have_text("Go on, all the way round")
    look("queue")
    played.play_piece(6)
    expect(card.locator(".do")).to_have_text(DONE)
    while card.count():  # its "Done" stays for some seconds, to be read
        page.clock.fast_forward(7000)
        page.wait_for_timeout(200)
    expect(page.locator(".queued")).to_have_count(6)
    for name in others:
        site.talk(said(name, boot=1, time_ns=time.time_ns()))
    expect(page.locator("#nobody")).to_have_text("No device waits to be calibrated: go back to the ward.")
    while page.locator(".queued").count():
        page.clock.fast_forward(7000)
        page.wait_for_timeout(200)
    expect(page.locator("#how")).to_be_hidden()  # there is no card that says anything
