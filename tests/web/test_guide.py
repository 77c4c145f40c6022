"""A calibration by hand with the page alone, in a real browser: a good one, a failed turn, a cancel, a reboot."""

import time
from collections.abc import Callable
from math import radians

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from bridge.sim.motion import Piece, Still, Turn
from bridge.wire.messages import CommandReply
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
from tests.estimator.batch.sessions import in_poses
from tests.estimator.guide.scripted import BATCH
from tests.estimator.stream import NAME, feed
from tests.sentences import free
from tests.web.conftest import PASSWORD, Site
from tests.web.played import Played
from tests.web.talk import about
from tests.web.test_browser import english, serious

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.timeout(300)]
Shot = Callable[[str], None]
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
    page.get_by_role("link", name="Log in to begin").click()
    page.get_by_label("Name").fill("nurse")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator(".guide")).to_be_visible()


@pytest.fixture
def played(site: Site) -> Played:
    return Played(site.talk)


def test_from_the_table_to_the_verdict_without_a_click(page: Page, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2), turn(0, -360.0), turn(1)))
    played.play(1.0)
    open_guide(page)
    page.evaluate(LISTEN)
    shot("guide-place")
    assert serious(page) == []
    played.play_piece(0)
    expect(page.locator("#do")).to_have_text("Turn it round once, flat on the table")
    expect(page.locator(".picture:visible")).to_have_attribute("data-picture", "flat")
    shot("guide-turn-flat")
    played.play_piece(1, 0.6)
    expect(page.locator("#do")).to_have_text("Go on, all the way round")
    expect(page.locator('#turns [data-mark="now"] .axis-name')).to_have_text("z")
    shot("guide-turning")
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
    page.set_viewport_size({"width": 1280, "height": 900})
    assert serious(page) == []
    played.play_piece(2, 0.3)
    expect(page.locator("#do")).to_have_text("Now let go of it")
    shot("guide-settle")
    played.play_piece(2)
    expect(page.locator("#do")).to_have_text("Roll it over once, away from you")
    expect(page.locator('#turns [data-mark="done"] .axis-name')).to_have_text("z")
    shot("guide-turn-along")
    # It went the other way round than the arrow: both count, and the arrow follows.
    played.play_piece(3, 0.6)
    expect(page.locator('.picture:visible [data-way="-1"]')).to_be_visible()
    played.play_piece(4)
    expect(page.locator("#do")).to_have_text("Tip it over once, sideways")
    shot("guide-turn-across")
    played.play_piece(6)
    expect(page.locator("#do")).to_have_text(DONE)
    expect(page.locator("#turns [data-mark='done']")).to_have_count(3)
    expect(page.locator("#rows tr")).to_have_count(3)
    expect(page.locator("#compared")).to_have_text("There is none to compare it with.")
    shot("guide-done")
    assert serious(page) == []
    # A screen reader hears each step once.
    heard = page.evaluate("window.heard")
    assert [one for i, one in enumerate(heard) if i and one == heard[i - 1]] == []
    assert 9 <= len(heard) <= 11, heard
    assert heard[-1].startswith(DONE)


def test_a_failed_turn_is_repeated(page: Page, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2), turn(0, 180.0), turn(0), turn(1)))
    open_guide(page)
    played.play_piece(4)
    expect(page.locator("#wrong")).to_contain_text("Turn it all the way round, once.")
    expect(page.locator("#do")).to_have_text("Again: roll it over once, away from you")
    shot("guide-failed")
    assert serious(page) == []
    played.play_piece(5, 0.6)
    expect(page.locator("#wrong")).to_be_hidden()
    played.play_piece(8)
    expect(page.locator("#do")).to_have_text(DONE)


def test_begun_and_cancelled_by_the_keyboard(page: Page, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2), turn(0), turn(1), Still(1.0), turn(2)))
    played.play_piece(6)
    open_guide(page, "It is calibrated")
    expect(page.locator("#rows tr")).to_have_count(3)
    expect(page.locator("#how")).to_contain_text("log in, and press Begin")
    shot("guide-idle")
    log_in(page)
    expect(page.locator("#how")).to_contain_text("press Begin. Then")
    page.get_by_role("button", name="Begin").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#do")).to_have_text(PLACE)
    expect(page.get_by_role("button", name="Begin")).to_be_hidden()
    played.play_piece(9, 0.6)
    expect(page.locator("#do")).to_have_text("Go on, all the way round")
    page.get_by_role("button", name="Cancel").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#do")).to_have_text("Cancelled")
    expect(page.locator("#wrong")).to_contain_text("nurse has cancelled.")
    expect(page.get_by_role("button", name="Begin")).to_be_visible()
    expect(page.get_by_role("button", name="Cancel")).to_be_hidden()
    # What was answered is said by the step itself, and nothing of it tells that this worked.
    expect(page.locator("#said")).to_have_count(0)
    expect(page.locator(".guide")).to_have_attribute("data-tone", "ask")
    expect(page.locator(".picture:visible .good")).to_have_count(0)
    shot("guide-cancelled")
    assert serious(page) == []


def test_a_refusal_stays_until_the_next_step(page: Page, site: Site, played: Played) -> None:
    played.switch_on(rests_between(turn(2), turn(0), turn(1)))
    open_guide(page)
    log_in(page)
    played.play_piece(6)
    expect(page.locator("#do")).to_have_text(DONE)
    site.talk.answer = lambda verb, device: CommandReply("", accepted=False, message=free("too busy: try again"))
    page.get_by_role("button", name="Begin").click()
    expect(page.locator("#said")).to_contain_text("too busy")
    # The guide that has followed knows how it came there, and tells it after the page was written by one that does not.
    expect(page.locator("#do")).to_have_text(DONE)
    expect(page.locator("#said")).to_contain_text("too busy")


def test_a_reboot_in_the_middle_is_said(page: Page, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2), turn(0)))
    open_guide(page)
    played.play_piece(2)
    expect(page.locator("#turns [data-mark='done']")).to_have_count(1)
    expect(page.locator("#rebooted")).to_be_hidden()
    played.switch_on(rests_between(turn(2), turn(0), turn(1)), seed=2)
    played.play(0.5)
    expect(page.locator("#rebooted")).to_contain_text("Start with the first one; nothing has to be pressed.")
    expect(page.locator("#turns [data-mark='done']")).to_have_count(0)
    shot("guide-rebooted")
    assert serious(page) == []
    played.play_piece(2)
    expect(page.locator("#turns [data-mark='done']")).to_have_count(1)
    expect(page.locator("#rebooted")).to_be_hidden()
    played.play_piece(6)
    expect(page.locator("#do")).to_have_text(DONE)


def test_two_tablets_and_two_languages(page: Page, site: Site, browser: Browser, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2), turn(0, 180.0)))
    open_guide(page)
    other = browser.new_context(base_url=site.url, locale="zh-CN").new_page()
    other.goto(f"/devices/{NAME}/calibrate")
    expect(other.locator("#do")).to_have_text("把设备放在桌边，然后松手")
    played.play_piece(4)
    expect(page.locator("#do")).to_have_text("Again: roll it over once, away from you")
    expect(other.locator("#do")).to_have_text("再来一次：向前翻滚一整圈")
    expect(other.locator("#wrong")).to_contain_text("请转满一整圈")
    other.get_by_role("link", name="English").click()
    expect(other.locator("#do")).to_have_text("Again: roll it over once, away from you")
    other.goto(f"/devices/{NAME}/calibrate")
    expect(other.locator("html")).to_have_attribute("lang", "en")
    other.context.close()
    page.get_by_role("link", name="中文").click()
    expect(page.locator("#do")).to_have_text("再来一次：向前翻滚一整圈")
    shot("guide-failed-zh")
    assert serious(page) == []


def test_a_device_that_is_gone_is_said(page: Page, played: Played, shot: Shot) -> None:
    played.switch_on(rests_between(turn(2)))
    open_guide(page)
    played.session.silence(free("no samples for 3 s"))
    played._say()
    expect(page.locator("#do")).to_have_text("Nothing is heard of it")
    shot("guide-away")
    assert serious(page) == []


def test_what_the_ward_cannot_hear_is_no_fault_of_the_device(
    page: Page, site: Site, played: Played, shot: Shot
) -> None:
    played.switch_on(rests_between(turn(2)))
    open_guide(page)
    played.play_piece(1, 0.6)
    expect(page.locator("#do")).to_have_text("Go on, all the way round")
    site.talk.die()
    expect(page.locator("#do")).to_have_text("The ward's computer does not answer", timeout=1500)
    expect(page.locator("#how")).to_contain_text("The device is well")
    page.goto(page.url + "?lang=zh")
    expect(page.locator("#do")).to_have_text("病区的电脑没有回应")
    assert english(page) == []
    shot("guide-broken-zh")
    assert serious(page) == []


def test_poses_instead_of_turns(page: Page, site: Site, shot: Shot) -> None:
    of = in_poses(7, 14, after=4)
    site.server.desk.treatment.usual = SessionKnobs(method="transitions")
    session = DeviceSession(NAME, site.server.desk.treatment.usual)
    site.talk(about(NAME, boot=1))
    sent = of.batches(range(BATCH, len(of), BATCH))

    def play(until_s: float) -> None:
        while sent and sent[0].device_time[-1] < until_s:
            batch = sent.pop(0)
            made = feed(session, [batch])
            site.talk(batch)
            if made.calibration is not None:
                site.talk(made.calibration)
            if made.changed:
                site.talk(session.status(time.time_ns()))
            time.sleep(0.004)

    play(2.2)
    open_guide(page)
    play(8.0)
    expect(page.locator("#do")).to_have_text("Lay it on another side, and let go")
    expect(page.locator("#turns li")).to_have_count(6)
    expect(page.locator(".picture:visible")).to_have_attribute("data-picture", "pose")
    shot("guide-pose")
    assert serious(page) == []
    page.goto(page.url + "?lang=zh")
    expect(page.locator("#turns li")).to_have_count(6)
    assert english(page) == []
    play(np.inf)
    expect(page.locator("#do")).to_have_text("完成：设备已校准")
