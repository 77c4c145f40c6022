"""The pages in a real browser, as a person uses them; TRUERATE_PICTURES=1 leaves pictures in out/screenshots."""

import re
import time
from dataclasses import replace
from datetime import datetime
from itertools import count
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from msgspec import structs
from playwright.sync_api import Page, Route, WebSocketRoute, expect
from scipy.spatial.transform import Rotation

from bridge.reasons.codes import Code
from bridge.wire.messages import (
    Alert,
    BootCause,
    CommandReply,
    CorrectedBatch,
    Note,
    OrientationBatch,
    Placement,
    Quality,
    Receipt,
    SampleBatch,
    State,
    Status,
)
from estimator.config.dashboard import Dashboard
from estimator.web import number_format as words
from tests.estimator.device.test_correction import CALIBRATION
from tests.sentences import free
from tests.web import page_state
from tests.web.asking import PASSWORD, PEOPLE
from tests.web.conftest import Look, Site
from tests.web.talk import about, said, until

#: without a word from the server for so long, the page says that it is old
LOST_MS = 5000
pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.timeout(300)]

NASTY = "<img src=x onerror=alert(1)><script>alert(2)</script>"


def now_ns() -> int:
    return time.time_ns()


def ward(site: Site, n: int = 20) -> list[str]:
    """n devices that track, told of now."""
    names = [f"bed-{i // 3 + 1:02d}-{('chest', 'wrist', 'ankle')[i % 3]}" for i in range(n)]
    for name in names:
        site.talk(about(name, boot=5, time_ns=now_ns(), battery_percent=82.0), tracking(name))
    heard(site, n)
    return names


def heard(site: Site, n: int) -> None:
    """Until the dashboard has heard of so many devices."""
    until(lambda: sum(story.status is not None for story in site.server.desk.known.stories.values()) >= n)


def tracking(name: str, **changes: Any) -> Status:
    plain = said(name, boot=5, time_ns=now_ns(), calibrated_time_ns=now_ns() - 7200 * 10**9, temperature_c=31.2)
    return replace(plain, reason=(Code.CALIBRATED(), Code.TURNS_CLOSED(angle_deg="0.12")), **changes)


def rates(site: Site, name: str, seconds: float, now_s: float) -> None:
    """Readings with a bias and their corrected rates; now_s: time of the first by the device's clock."""
    n, hz, at_ns = round(104 * seconds), 104.0, now_ns()
    std = np.full(3, 0.001, np.float32)
    for begin in range(0, n, 52):
        time_s = np.arange(begin, min(begin + 52, n)) / hz
        first, begins_ns = round(now_s * hz) + begin, at_ns + round(begin / hz * 1e9)
        ticks, flags = (1e6 * (round(now_s * hz) / hz + time_s)).astype(np.uint64), np.zeros(len(time_s), np.uint32)
        rate = np.stack([np.sin(3 * time_s), np.cos(2 * time_s), 0.2 * np.sin(9 * time_s)], axis=1).astype(np.float32)
        read = rate * 0.9 + np.float32(0.05)
        raw = SampleBatch(name, 5, first, begins_ns, begins_ns, 1e-6, 1.0, ticks, read, None, None, flags)
        of = CorrectedBatch(
            name, 5, first, begins_ns, 1e-6, 1.0, ticks, rate, flags, Quality.GOOD, std, std, std, std, "c", std
        )
        site.talk(raw, of)


def turning(page: Page, site: Site, name: str, words: str) -> None:
    """Rates come until the page says so of the heading; what comes before the page listens is for nobody."""
    begin_s = time.monotonic()
    for k in count():
        if words in page.locator("#heading").inner_text():
            return
        rates(site, name, 0.5, begin_s + 0.5 * k)
        page.wait_for_timeout(100)


def log_in(page: Page, to: str = "/", password: str = PASSWORD) -> None:
    page.goto(f"/login?to={to}")
    page.get_by_label("Name").fill("nurse")
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Log in").click()


#: what is English in every language: code, keys of a file, names of products
_CODE = re.compile(r"`[^`]*`|\[dashboard\]|JavaScript|sim-imu [\d.]+|all is well")
#: two words of a sentence
_ENGLISH = re.compile(r"[A-Za-z]{2,} [a-z]{2,}")
_SHOWN = """() => {
  const found = [document.title];
  for (const one of document.querySelectorAll("body *")) {
    if (["SCRIPT", "STYLE", "NOSCRIPT"].includes(one.tagName)) continue;
    for (const child of one.childNodes) if (child.nodeType === Node.TEXT_NODE) found.push(child.textContent);
    for (const name of ["aria-label", "aria-valuetext", "alt", "placeholder", "title"]) found.push(one.getAttribute(name) ?? "");
  }
  return found.concat([...document.querySelectorAll("noscript")].map((one) => one.textContent.replace(/<[^>]*>/g, "")));
}"""


_COUNT_BEEPS = """window.beeps = 0; window.AudioContext = class extends AudioContext {
  createOscillator() { window.beeps++; return super.createOscillator(); } };"""
#: how many tiles are seen whole
_SEEN = """[...document.querySelectorAll(".tile")].filter((tile) => tile.getBoundingClientRect().bottom <= innerHeight
  && tile.scrollHeight <= tile.clientHeight + 1).length"""


def chinese(page: Page) -> None:
    """No English sentence is seen or heard by a screen reader, but for code and what people have written; it fits 320 px."""
    assert [words for words in page.evaluate(_SHOWN) if _ENGLISH.search(_CODE.sub("", words))] == []
    page.set_viewport_size({"width": 320, "height": 900})
    page_state.wait_for(page, "document.documentElement.scrollWidth <= 320")
    page.set_viewport_size({"width": 1280, "height": 900})


def test_the_ward_at_one_look(page: Page, site: Site, look: Look) -> None:
    names = ward(site)
    site.talk(
        said(names[7], State.LOST, boot=5, time_ns=now_ns()), said(names[4], State.DEGRADED, boot=5, time_ns=now_ns())
    )
    site.talk(replace(said(names[7], State.LOST, boot=5, time_ns=now_ns()), reason=(Code.NO_SAMPLES(duration="12 s"),)))
    site.talk(about(names[2], boot=5, time_ns=now_ns(), battery_percent=9.0))
    page.goto("/")
    expect(page.get_by_role("heading", level=1)).to_have_text("18 of 20 tracking")
    first = page.locator(".tile").first
    expect(first.locator("h2")).to_have_text(names[7])
    expect(first.locator(".state")).to_contain_text("lost")
    expect(first.locator(".reason")).to_have_text("No samples have come for 12 s.")
    assert [page.locator(".tile h2").nth(i).inner_text() for i in (1, 2)] == [names[2], names[4]]
    look("ward")
    # Filters, search and order.
    page.get_by_role("button", name="need a person 3").click()
    expect(page.locator(".tile:visible")).to_have_count(3)
    page.get_by_role("button", name="need a person 3").click()
    page.get_by_label("Find").fill("chest")
    expect(page.locator(".tile:visible")).to_have_count(7)
    expect(page.locator("#unlike")).to_contain_text("7 of 20 are shown.")
    page.get_by_label("Find").fill("zzz")
    expect(page.locator("#unlike")).to_contain_text("No device is like that.")
    page.get_by_role("button", name="Show all").click()
    expect(page.locator(".tile:visible")).to_have_count(20)
    page.get_by_label("Find").fill("")
    page.get_by_label("Order").select_option("id")
    expect(page.locator(".tile h2").first).to_have_text("bed-01-ankle")


def test_an_alert_comes_sounds_once_it_may_and_goes(page: Page, site: Site) -> None:
    names = ward(site, 2)
    lost = Alert("lost", now_ns(), now_ns())
    page.add_init_script(_COUNT_BEEPS)
    page.goto("/")
    expect(page.locator("#alerts")).to_be_hidden()
    site.talk(said(names[0], State.LOST, boot=5, time_ns=now_ns(), alerts=(lost,), placement=Placement(wearer="bed-3")))
    expect(page.locator("#alerts li")).to_contain_text(f"{names[0]} (bed-3): no contact.")
    expect(page.locator(f'[data-id="{names[0]}"] .placement')).to_have_text("bed-3")
    assert page.evaluate("window.beeps") == 0, "off until somebody switches it on"
    page.get_by_role("button", name="Sound of alerts").click()
    page_state.wait_for(page, "window.beeps > 0")
    seen = replace(lost, acknowledged_ns=now_ns(), who="anna")
    site.talk(said(names[0], State.LOST, boot=5, time_ns=now_ns(), alerts=(seen,)))
    expect(page.locator("#alerts li")).to_contain_text("Seen by anna")
    site.talk(tracking(names[0]))
    expect(page.locator("#alerts")).to_be_hidden()


def test_twenty_devices_at_one_look_sixty_on_a_wall_and_numbers_on_request(page: Page, site: Site, look: Look) -> None:
    names = ward(site)
    worn = Placement(segment="humerus", side="left", wearer="bed-3")

    def all_wait(names: list[str]) -> None:
        """Where all of them are worn and need a hand, tiles are tallest."""
        for name in names:
            waiting = said(name, State.AWAITING_STILL, boot=5, time_ns=now_ns(), reason=(Code.HOLD_STILL(),))
            site.talk(replace(waiting, placement=worn))

    all_wait(names)
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto("/")
    expect(page.locator(".advice", has_text="Calibrate it with three turns.")).to_have_count(20)
    page_state.wait_for(page, f"{_SEEN} === 20")
    assert not re.search(r"http|Hz|zaru|\d °/s", page.locator("main").inner_text())
    assert page.locator(".strip:visible").count() == 0
    page.get_by_role("button", name="Numbers").click()
    expect(page.locator(".strip:visible")).to_have_count(20)
    expect(page.locator('[data-of="rate"]:visible').first).to_contain_text("Hz")
    page.reload()
    expect(page.locator(".strip:visible")).to_have_count(20)
    page.get_by_role("button", name="Numbers").click()
    page.set_viewport_size({"width": 390, "height": 844})
    page_state.wait_for(page, "document.documentElement.scrollWidth <= 390")
    all_wait(ward(site, 60))
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.goto("/?wall=1")
    expect(page.locator(".advice", has_text="Calibrate it with three turns.")).to_have_count(60)
    page_state.wait_for(page, f"{_SEEN} === 60")
    assert page.locator("main :is(button, input, select):visible").count() == 0
    expect(page.get_by_role("time")).to_have_text(re.compile(r"\d+:\d\d:\d\d"))
    look("wall")


def tab_to(page: Page, selector: str) -> None:
    """By the keyboard alone, with the focus visible all the way."""
    for _ in range(60):
        page.keyboard.press("Tab")
        focus = page.evaluate(
            """wanted => { const at = document.activeElement, style = getComputedStyle(at);
          return [at.matches(wanted), style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2]; }""",
            selector,
        )
        assert focus[1], f"the focus is not seen on {page.evaluate('document.activeElement.outerHTML')[:200]}"
        if focus[0]:
            return
    raise AssertionError(f"{selector} is not reached")


def test_at_200_percent_and_by_the_keyboard_alone(page: Page, site: Site) -> None:
    """A screen of 1280 by 900 that is zoomed to 200 % has 640 by 450 pixels of CSS."""
    names = ward(site, 6)
    site.talk(said(names[3], State.AWAITING_STILL, boot=5, time_ns=now_ns(), reason=(Code.HOLD_STILL(),)))
    page.set_viewport_size({"width": 640, "height": 450})

    def fits_and_shows(selector: str) -> None:
        expect(page.locator(selector).first).to_be_visible()
        page.wait_for_load_state()  # with its styles
        page_state.wait_for(page, "document.documentElement.scrollWidth <= 640")
        box = page.locator(selector).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] / 2 <= 450, f"{selector} is below the screen of {page.url}"

    page.goto("/")
    expect(page.locator(".tile").first.locator("h2")).to_have_text(names[3])
    tab_to(page, ".tile .calibrate a")
    fits_and_shows(".tile .calibrate a")
    page.keyboard.press("Enter")
    fits_and_shows("#do")
    fits_and_shows("#ring")
    page.goto(f"/devices/{names[3]}")
    fits_and_shows(".commands .button")
    for depth in ("signals", "engineering"):
        tab_to(page, f"#{depth} summary")
        page.keyboard.press("Enter")
        expect(page.locator(f"#{depth}")).to_have_attribute("open", "")
    page_state.wait_for(page, "document.documentElement.scrollWidth <= 640")


def test_a_calibration_that_was_left_is_called_so(page: Page, site: Site) -> None:
    """Two turns, and never a third: the ward page says that somebody has to go on, as `truerate status` does."""
    names = ward(site, 2)
    taken = (Code.TURN_TAKEN(axis="x"), Code.TURNS_NEEDED(axes="y"))
    site.talk(said(names[0], State.TURNING, boot=5, time_ns=now_ns(), axes_done=(0, 2), reason=taken))
    page.goto("/")
    expect(page.get_by_role("button", name="need a person")).to_have_text("need a person 1")
    expect(page.locator(".tile").first).to_have_attribute("data-tone", "ask")
    expect(page.locator(".tile .advice").first).to_have_text("Go on turning it: 2 of 3 turns are done.")
    page.goto("/report")
    expect(page.locator(".needs")).to_contain_text(names[0])


def test_what_changes_is_never_silent(page: Page, site: Site, look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    page.clock.install()
    page.goto("/")
    expect(page.locator("#none")).to_contain_text("Switch a device on.")
    expect(page.locator(".choose")).to_be_hidden()
    look("ward-empty")
    names = ward(site, 6)
    expect(page.get_by_role("heading", level=1)).to_have_text("6 of 6 tracking")
    # It starts again: said on its tile, and to those who cannot see it.
    boot = about(names[3], boot=6, boot_cause=BootCause.POWER_UP, time_ns=now_ns(), battery_percent=80.0)
    waiting = said(names[3], State.AWAITING_STILL, boot=6, time_ns=now_ns(), progress=0.0)
    site.talk(boot, replace(waiting, reason=(Code.HOLD_STILL(),)))
    expect(page.locator(".tile").first.locator(".rebooted")).to_contain_text("it must be calibrated again")
    expect(page.locator("#told")).to_contain_text(f"{names[3]}: to be calibrated")
    look("ward-rebooted")
    page.goto(f"/devices/{names[3]}")
    expect(page.locator(".rebooted")).to_contain_text("it must be calibrated again")
    look()
    page.goto("/")
    # Nothing more is said of them: after a few seconds that is what they are.
    site.talk.hush()
    monkeypatch.setattr("estimator.overview.ward.SILENT_S", 0.1)
    expect(page.locator(".tile .state").first).to_contain_text("silent")
    # Bridge and estimator die, then the router, then the dashboard itself.
    site.talk.die()
    expect(page.locator("#troubles")).to_contain_text("No estimator is alive")
    look("ward-dead")
    for bus in site.buses:
        bus.detach()
    expect(page.locator("#troubles")).to_contain_text("router is gone")
    expect(page.locator(".tile .state").first).to_have_text("unknown")
    expect(page.locator(".tile .reason").first).to_contain_text("The router is gone")
    look("ward-without-router", axe=False)
    site.stop()
    page.clock.fast_forward(LOST_MS)
    expect(page.locator("#lost")).to_contain_text("what is shown is old")
    look("ward-without-dashboard")


def test_a_connection_that_dies_without_a_word_is_made_anew(page: Page, site: Site) -> None:
    names, made, dead, told = ward(site, 2), list[WebSocketRoute](), list[WebSocketRoute](), list[WebSocketRoute]()

    def between(socket: WebSocketRoute) -> None:
        made.append(socket)
        server = socket.connect_to_server()

        def tell(frame: str | bytes) -> None:
            if socket not in dead:
                socket.send(frame)
                told.append(socket)

        socket.on_message(server.send)
        server.on_message(tell)

    page.clock.install()
    page.route_web_socket("**/live", between)
    page.goto("/")
    expect(page.get_by_role("heading", level=1)).to_have_text("2 of 2 tracking")
    while not told:  # the heading is there before its socket is open
        page.wait_for_timeout(20)
    dead += made
    site.talk(said(names[1], State.DEGRADED, boot=5, time_ns=now_ns()))
    page.clock.fast_forward(11_000)
    expect(page.get_by_role("heading", level=1)).to_have_text("1 of 2 tracking")
    assert len(made) == 2


def test_a_device(page: Page, site: Site, look: Look) -> None:
    ward(site, 3)
    name = "bed-01-chest"
    site.talk(
        replace(CALIBRATION, device=name, boot=5, time_ns=now_ns() - 60 * 10**9, who="nurse"),
        Note(name, 5, now_ns(), "nurse", "sat up"),
        tracking(name, evidence_age_s=0.5, calibration=CALIBRATION.id),
    )
    held = list[Route]()

    def hold(route: Route) -> None:
        held.append(route)

    page.route("**/device.js", hold)
    page.goto(f"/devices/{name}", wait_until="commit")
    page.get_by_text("Signals").click()  # what is opened before the page's script runs stays open, and is filled
    while not held:
        page.wait_for_timeout(20)
    held[0].continue_()
    expect(page.get_by_role("heading", level=1)).to_have_text(name)
    expect(page.locator("#notes")).to_contain_text("sat up")
    expect(page.locator("#calibrations")).to_contain_text("in use")
    page.locator("#engineering summary").click()
    expect(page.locator("#filter")).to_have_text("Change nothing: the next rest brings the first measurement.")
    for _ in range(2):
        seen = Receipt(now_ns(), "zaru level", (0.01, -0.02), (0.005, 0.005), 2.0, 0.1, accepted=True)
        late = Receipt(
            now_ns() + 1, "zaru vertical", (0.5,), (0.01,), 99.0, 4.1, accepted=False, reason="outside the gate"
        )
        site.talk(tracking(name, evidence_age_s=0.5, nis=0.97, receipts=(seen, late)))
    expect(page.locator("#receipts tbody tr")).to_have_count(4)
    expect(page.locator("#receipts tbody tr").first).to_contain_text("refused: outside the gate")
    expect(page.locator("#receipts")).to_contain_text("−1.1459 ± 0.5615")
    expect(page.locator("#nis-mean")).to_contain_text("0.97")
    expect(page.locator("#filter")).to_have_text(
        "Many measurements are refused. Lay the device down still for a minute."
    )
    site.talk(tracking(name, evidence_age_s=0.5, nis=0.97, receipts=(seen._replace(time_ns=now_ns()),)))
    expect(page.locator("#filter")).to_have_text("The bias filter agrees with its measurements. Change nothing.")
    expect(page.locator("#filter")).to_have_attribute("data-tone", "well")
    turning(page, site, name, "By its raw rates alone")
    expect(page.locator("#heading")).to_contain_text(
        f"{words.zone_name(datetime.now().astimezone())}, when it last rested"
    )
    drawn = """[...document.querySelectorAll("#rates canvas")].every((canvas) =>
      canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value))"""
    page_state.wait_for(page, drawn)
    # A picture is as wide as its place, though it was made while that was hidden, and nothing was resized since.
    assert page.evaluate("""[...document.querySelectorAll(".charts:not([hidden]) figure:not([hidden])")].every((figure) =>
      Math.abs(figure.querySelector(".uplot").offsetWidth - figure.clientWidth) <= 1)""")
    look("device")
    expect(page.get_by_role("link", name="Log in to do more")).to_be_visible()


def test_a_device_turns_on_its_page_as_it_is_turned(page: Page, site: Site, look: Look) -> None:
    ward(site, 1)
    name = "bed-01-chest"
    page.emulate_media(reduced_motion="no-preference")
    page.goto(f"/devices/{name}")
    expect(page.locator("#attitude")).to_be_hidden()

    def lies(*angles_deg: float) -> list[list[float]]:
        """Ends of the sensor's axes on the screen: right, down, to the viewer. Turned about earth z, tilted about its x."""
        turned = Rotation.from_euler("zx", angles_deg, degrees=True)
        quat = np.tile(turned.as_quat(scalar_first=True), (5, 1)).astype(np.float32)
        cov = np.diag(np.radians([0.2, 0.2, 3.0]) ** 2).astype(np.float32)
        ticks = np.arange(5, dtype=np.uint64)
        site.talk(OrientationBatch(name, 5, 0, now_ns(), 0.01, 1.0, ticks, quat, None, cov, 0, "start", Quality.GOOD))
        east, north, up = turned.as_matrix()
        return [[east[axis], -up[axis], -north[axis]] for axis in range(3)]

    drawn = """() => { const m = new DOMMatrix(getComputedStyle(document.querySelector(".sensor")).transform);
      return [m.m11, m.m12, m.m13, m.m21, m.m22, m.m23, m.m31, m.m32, m.m33]; }"""
    for angles in ((0.0, 0.0), (40.0, 0.0), (-30.0, 25.0)):
        found, expected = [0.0] * 9, [1.0] * 9
        while not np.allclose(found, expected, atol=0.01):
            x, y, z = lies(*angles)
            expected = [*x, *(-v for v in z), *(-v for v in y)]  # in CSS a box has its y down and its z to the viewer
            page.wait_for_timeout(150)
            found = page.evaluate(drawn) if page.locator("#attitude").is_visible() else [0.0] * 9
    expect(page.locator("#attitude-words")).to_have_text(
        "Tilted by 25.0° ± 0.6°. Turned by -30.0° ± 5.9° since its zero."
    )
    look("attitude")
    expect(page.locator("#attitude")).to_be_hidden()  # nothing comes any more


def test_who_may_and_who_may_not(page: Page, site: Site, look: Look) -> None:
    ward(site, 2)
    log_in(page, "/devices/bed-01-chest", "wrong password")
    expect(page.get_by_role("alert").filter(has_text="wrong")).to_have_text("The name or the password is wrong.")
    for language in ("中文", "English"):  # where it goes on to is kept
        page.get_by_role("link", name=language).click()
        expect(page.locator('[name="to"]')).to_have_value("/devices/bed-01-chest")
    log_in(page, "/devices/bed-01-chest", "wrong password")
    look("login-wrong")
    log_in(page, "/devices/bed-01-chest")
    expect(page.locator(".person")).to_contain_text("nurse")
    page.get_by_role("button", name="Recalibrate").click()
    expect(page.locator("#said").filter(has_text="recalibrate")).to_have_text("bed-01-chest: recalibrate it is")
    note = page.get_by_role("textbox", name="Note")
    expect(note).to_have_accessible_description("what happened; never a patient's name")
    note.fill("sat up & <b>ate</b>")
    expect(page.locator("#note-hint")).to_be_visible()
    page.get_by_role("button", name="Write it down").click()
    expect(page.locator("#said").filter(has_text="note")).to_have_text("bed-01-chest: note it is")
    assert site.talk.asked == [
        ("bed-01-chest", "recalibrate", "nurse", ""),
        ("bed-01-chest", "note", "nurse", "sat up & <b>ate</b>"),
    ]
    look("device-logged-in")
    page.get_by_role("button", name="Log out").click()
    expect(page.get_by_role("link", name="Log in")).to_be_visible()


def test_a_page_of_a_device_gives_one_order_and_offers_what_can_be_done(page: Page, site: Site, look: Look) -> None:
    new, lost = ward(site, 2)
    site.talk(said(new, State.AWAITING_STILL, boot=5, time_ns=now_ns(), reason=(Code.HOLD_STILL(),)))
    site.talk(said(lost, State.LOST, boot=5, time_ns=now_ns(), reason=(Code.NO_SAMPLES(duration="40 s"),)))
    log_in(page, f"/devices/{new}")
    expect(page.locator(".device > .advice")).to_have_text("Calibrate it with three turns.")
    expect(page.locator("main")).not_to_contain_text("Hold the device still")
    expect(page.locator("main")).not_to_contain_text("·")
    expect(page.get_by_role("link", name="Calibrate, step by step")).to_be_visible()
    for button in ("Recalibrate", "Cancel the calibration"):
        expect(page.get_by_role("button", name=button)).to_be_hidden()
    expect(page.locator("#blocked")).to_be_empty()
    wearer = page.get_by_label("Bed or pseudonym")
    expect(wearer).to_have_accessible_description("such as bed-3 or P07; never a patient's name")
    # The hint stands under its own field, whatever the width.
    for width in (1280, 700, 320):
        page.set_viewport_size({"width": width, "height": 900})
        page_state.wait_for(page, f"document.documentElement.scrollWidth <= {width}")
        field, hint, label = (
            page.locator(one).bounding_box() for one in ("[name=wearer]", "#wearer-hint", ".wearer label")
        )
        assert field is not None
        assert hint is not None
        assert label is not None
        assert 0 <= hint["y"] - (field["y"] + field["height"]) < 16
        assert abs(hint["x"] - label["x"]) <= 1
    page.set_viewport_size({"width": 1280, "height": 900})
    expect(page.locator(".progress")).to_be_hidden()
    site.talk(said(new, State.TURNING, boot=5, time_ns=now_ns(), axes_done=(0, 2)))
    expect(page.locator(".state .turns")).to_have_text("(x, z done)")
    expect(page.locator(".progress")).to_be_visible()
    expect(page.get_by_role("link", name="Go on, step by step")).to_be_visible()
    expect(page.get_by_role("button", name="Cancel the calibration")).to_be_visible()
    site.talk(tracking(new))
    expect(page.get_by_role("button", name="Cancel the calibration")).to_be_hidden()
    expect(page.get_by_role("button", name="Recalibrate")).to_be_visible()
    page.goto(f"/devices/{lost}")
    expect(page.get_by_role("link", name="Calibrate, step by step")).to_be_hidden()
    for depth in ("signals", "engineering"):
        page.locator(f"#{depth} summary").click()
        expect(page.locator(f"#{depth} > .verdict")).to_have_text("Check that it is on, charged and near.")
    expect(page.locator("#pause")).to_be_hidden()
    expect(page.locator(".key", has_text="over the last 20 seconds")).to_be_hidden()
    expect(page.locator("#receipts")).to_be_hidden()
    expect(page.get_by_role("heading", name="NIS of each measurement")).to_be_hidden()
    look("device-lost")


def test_people_are_managed_on_any_screen_in_both_languages(page: Page, site: Site, look: Look) -> None:
    chief = structs.replace(PEOPLE[0], name="chief", role="administrator")
    site.server.desk.use(Dashboard(people=(chief, *PEOPLE)), site.server.desk.treatment)
    page.goto("/login?to=/people")
    page.get_by_label("Name").fill("chief")
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Log in").click()
    page.wait_for_url("**/people")
    expect(page.get_by_role("heading", name="nurse")).to_be_visible()
    look("people")
    key = site.server.desk.invitations.begin("nurse", time.monotonic())
    for path in ("/people", f"/welcome?key={key}"):
        page.goto(path)
        look()
        page.goto(f"{path}{'&' if '?' in path else '?'}lang=zh")
        chinese(page)
        page.goto("/?lang=en")


def test_words_of_strangers_are_words(page: Page, site: Site, look: Look) -> None:
    name = "bed-01-chest"

    def talk(words: str) -> None:
        site.talk(
            about(
                name,
                boot=5,
                model=NASTY[:60],
                firmware="'\"><svg/onload=alert(3)>",
                trouble=free(words),
                notices=free(NASTY),
            ),
            replace(said(name, State.DEGRADED, boot=5, time_ns=now_ns()), events={NASTY[:50] + ": x": 3}),
            Note(name, 5, now_ns(), "<i>", words),
            replace(CALIBRATION, device=name, boot=5, time_ns=now_ns(), who="<u>", reason=free(NASTY)),
        )

    talk(NASTY)
    heard(site, 1)
    for path, place, more in (("/", ".reason", " once more"), (f"/devices/{name}", "#notes", " and again")):
        page.goto(path)
        expect(page.locator(place)).to_contain_text(NASTY)
        talk(NASTY + more)  # what the server wrote first, the page's script writes anew
        expect(page.locator(place)).to_contain_text(NASTY + more)
        assert page.locator("main img, main script, main i, main u").count() == 0
    for place in ("#calibrations", "#events", "#facts"):
        expect(page.locator(place)).to_contain_text(NASTY[:40])
    look("strangers", axe=False)


def test_pages_are_light_and_stay_at_home(page: Page, site: Site) -> None:
    ward(site, 60)
    sizes: dict[str, int] = {}
    page.on("response", lambda answer: sizes.__setitem__(answer.url, len(answer.body())))
    for path in ("/", "/?lang=zh", "/devices/bed-01-chest", "/devices/bed-01-chest/calibrate", "/report", "/login"):
        sizes.clear()
        page.goto(path)
        page.wait_for_load_state("networkidle")
        assert sum(sizes.values()) <= 160_000, sizes
        assert all(url.startswith(site.url) for url in sizes)


def test_everything_of_a_chinese_page_is_chinese(page: Page, site: Site, look: Look) -> None:
    names = ward(site, 8)
    reasons = {
        State.LOST: (Code.NO_SAMPLES(duration="12.0 s"), Code.BRIDGE_GONE(bridge="bridge")),
        State.DEGRADED: (Code.REST_CONTRADICTS_BIAS(rate_dps="1.20"),),
        State.TURNING: (Code.TURN_TAKEN(axis="x"), Code.TURNS_NEEDED(axes="y, z")),
        State.AWAITING_STILL: (Code.HOLD_STILL(),),
    }
    for name, (state, reason) in zip(names, reasons.items(), strict=False):
        site.talk(replace(said(name, state, boot=5, time_ns=now_ns()), reason=reason, dropped={"out_of_range": 0}))
    slow = (Code.RATE_DIFFERS(measured_hz="99", told_hz="104"),)
    site.talk(about(names[4], boot=5, time_ns=now_ns(), battery_percent=9.0, notices=slow))
    name = names[5]
    busy = (Code.PORT_HELD(place="/dev/ttyUSB0", holders="minicom (12)"),)
    site.talk(
        about(name, boot=6, boot_cause=BootCause.POWER_UP, time_ns=now_ns(), trouble=busy, dropped={"malformed": 3}),
        replace(CALIBRATION, device=name, boot=6, time_ns=now_ns(), who="nurse"),
        Note(name, 6, now_ns(), "nurse", "坐起来了"),
        tracking(name, dropped={"duplicate": 2}, events={"gaps": 3, "zaru: outside the gate": 1}),
        tracking(name, boot=6, dropped={"duplicate": 2}, events={"gaps": 3, "zaru: outside the gate": 2}),
    )
    page.goto("/?lang=zh")
    expect(page.get_by_role("heading", level=1)).to_have_text("4 / 8 台正常跟踪")
    page.wait_for_timeout(1500)
    chinese(page)
    look("ward-zh")
    page.goto(f"/devices/{name}#signals")  # the language is remembered
    expect(page.locator("#events")).to_contain_text("超出门限")
    turning(page, site, name, "仅用原始读数")
    chinese(page)
    look("device-zh")
    for path in (f"/devices/{name}/calibrate", f"/devices/{name}/calibrations/{CALIBRATION.id}/certificate", "/report"):
        page.goto(path)
        chinese(page)
    page.goto("/devices/nobody")
    expect(page.get_by_role("heading", level=1)).to_have_text("没有成功")
    chinese(page)
    look("fault-zh", axe=False)
    page.goto(f"/login?to=/devices/{names[1]}")
    page.get_by_label("姓名").fill("nurse")
    page.get_by_label("密码").fill("wrong password")
    page.locator("main button").click()
    expect(page.locator("#wrong")).to_have_text("姓名或密码不对。")
    chinese(page)
    look("login-zh", axe=False)
    page.get_by_label("密码").fill(PASSWORD)
    page.locator("main button").click()
    taken = (Code.TURN_TAKEN(axis="x"), Code.TURNS_NEEDED(axes="y, z"))
    refused = (Code.ALREADY_DUE(device=names[1]),)
    for reply in (CommandReply("", accepted=True, message=taken), CommandReply("", accepted=False, message=refused)):
        site.talk.answer = Mock(return_value=reply)
        page.get_by_role("button", name="重新校准").click()
        expect(page.locator("#said")).to_be_visible()
        chinese(page)
    look("device-answer-zh", axe=False)
    site.talk.die()
    page.goto("/")
    expect(page.locator("#troubles")).to_contain_text("没有估计器在运行")
    for bus in site.buses:
        bus.detach()
    expect(page.locator("#troubles")).to_contain_text("病区的路由器不在")
    expect(page.locator(".tile .reason").first).to_contain_text("路由器不在")
    chinese(page)
    look("ward-without-router-zh", axe=False)
    page.clock.install()
    site.stop()
    page.clock.fast_forward(LOST_MS)
    expect(page.locator("#lost")).to_contain_text("显示的内容是旧的")
    chinese(page)
