"""Calibrations on a ward of real processes by somebody who does what the pages say: a good one, and what goes wrong."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from estimator.demo.ward import Ward
from tests.ward.hand import Hand, Table
from tests.ward.parts import kept, until
from tests.ward.test_dashboard import _open
from tests.web.asking import PASSWORD, PEOPLE
from tests.web.conftest import OUT

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(300)]
#: one device for each test
NAME, OTHER = "wrist", "ankle"
#: how much faster than life the devices live, which lie still until somebody turns them
SPEED = 4.0


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ward]:
    with Ward(tmp_path_factory.mktemp("ward"), (NAME, OTHER)) as made:
        (person,) = PEOPLE
        with made.config.open("a", encoding="utf-8") as file:
            file.write(f'[[dashboard.people]]\nname = "{person.name}"\npassword = "{person.password}"\n')
        made.start("router", "estimator", "bridge", "dashboard")
        yield made


@pytest.fixture
def page(ward: Ward, browser: Browser) -> Iterator[Page]:
    context = browser.new_context(base_url=f"http://{ward.page}")
    context.set_default_timeout(60_000)
    made = context.new_page()
    _open(made, "/")
    yield made
    context.close()
    assert "Traceback" not in ward.log("dashboard")


def picture(page: Page, name: str) -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=OUT / f"real-{name}.png", full_page=True)


def test_a_newcomer_from_the_ward_page_to_the_verdict(
    ward: Ward, page: Page, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    expect(page.locator(f'.tile[data-id="{NAME}"]')).to_be_visible()
    words = [sys.executable, "-m", "estimator.cli.main", "calibrate", "--live", NAME, "--config", str(ward.config)]
    told = tmp_path / "terminal"
    with told.open("wb") as out:
        terminal = subprocess.Popen([*words, "--lang", "en", "--seconds", "280"], stdout=out, stdin=subprocess.DEVNULL)
    request.addfinalizer(terminal.wait)
    request.addfinalizer(terminal.kill)  # before that
    while not told.stat().st_size:  # it says that nothing is heard of it: it listens
        time.sleep(0.05)
        assert terminal.poll() is None
    table = Table(NAME, 4)
    begin, port = time.monotonic(), ward.plug(NAME, table.device, speed=SPEED, lossless=True)
    hand = Hand(page, table)
    hand.from_the_ward_page(NAME)
    page.evaluate(STEPS)
    hand.follow()
    expect(page.locator("#do")).to_have_text("Done: it is calibrated")
    took_s, lived_s = time.monotonic() - begin, port.device_time_s
    expect(page.locator("#rows tr")).to_have_count(3)
    picture(page, "guide-done")
    steps = page.evaluate("window.seen")
    # In which order is for tests/web/test_guide.py: where the machine is busy, statuses come later than readings.
    assert {"turn", "turning", "settle", "done"} <= set(steps)
    assert steps[-1] == "done"
    page.get_by_role("link", name="Certificate, to print").click()
    expect(page.locator(".verdict")).to_contain_text(f"{NAME}: accepted")
    assert page.locator(".figure").evaluate("picture => picture.decode().then(() => picture.naturalWidth)") > 1000
    picture(page, "certificate")
    assert terminal.wait(60) == 0
    # Of the steps before, a terminal on a busy machine may miss any: it hears one a second.
    assert "Done: it is calibrated" in told.read_text(encoding="utf-8")
    print(f"from plugging it in to the verdict: {took_s:.0f} s, {lived_s:.0f} s of the device's time")  # noqa: T201


def test_a_turn_that_fails_a_cancel_and_a_reboot(ward: Ward, page: Page) -> None:
    table = Table(OTHER, 5)
    ward.plug(OTHER, table.device, speed=SPEED, lossless=True)
    hand, do = Hand(page, table), page.locator("#do")
    hand.from_the_ward_page(OTHER)
    # Half a turn does not count: it is said why, and only that one is asked for again.
    hand.follow(turns=2, half="along")
    expect(page.locator("#wrong")).to_contain_text("Turn the device once all the way round.")
    expect(do).to_have_text("Again: roll it over once, away from you")
    expect(page.locator('#turns [data-mark="done"] .axis-name')).to_have_text("z")
    picture(page, "guide-failed")
    hand.follow()
    expect(do).to_have_text("Done: it is calibrated")
    # Anew, as the nurse; cancelled in the middle of a turn: the calibration before stays.
    page.get_by_role("link", name="Log in to calibrate").click()
    page.get_by_label("Name").fill("nurse")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    hand.begin()
    hand.follow(turns=1)
    page.get_by_role("button", name="Cancel").click()
    expect(do).to_have_text("Cancelled")
    expect(page.locator("#wrong")).to_contain_text("nurse cancelled the calibration.")
    picture(page, "guide-cancelled")
    # Again, and it loses its power with a turn done: said, and it goes on with the first turn by itself.
    hand.begin()
    hand.follow(turns=1)
    hand.wait_for(("turn",))
    table.reboot()
    expect(page.locator("#rebooted")).to_contain_text("The turns are lost.")
    expect(page.locator('#turns [data-mark="done"]')).to_have_count(0)  # until then the step is that before the reboot
    picture(page, "guide-rebooted")
    hand.follow()
    expect(do).to_have_text("Done: it is calibrated")
    expect(page.locator("#rebooted")).to_be_hidden()
    done = [("recalibrate", "nurse"), ("cancel", "nurse"), ("recalibrate", "nurse")]
    until("estimator", lambda: [(row["verb"], row["who"]) for row in kept(ward, OTHER).commands] == done, ward)
    twice = ["ACCEPTED", "ACCEPTED"]
    until("estimator", lambda: [c.verdict.name for c in kept(ward, OTHER).calibrations] == twice, ward)


STEPS = """{
  const page = document.querySelector(".guide");
  window.seen = [];
  new MutationObserver(() => {
    if (window.seen.at(-1) !== page.dataset.step) window.seen.push(page.dataset.step);
  }).observe(page, { attributes: true, attributeFilter: ["data-step"] });
}"""
