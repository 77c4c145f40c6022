"""The dashboard of a simulated ward with real processes, in a real browser: booted, calibrated, rebooted, commanded, cut off."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Error, Page, expect

from estimator.demo.ward import Ward
from tests.ward.parts import kept, living, until
from tests.web.asking import PASSWORD, PEOPLE
from tests.web.conftest import OUT

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(300)]
NAME = "wrist"


@pytest.fixture
def ward(tmp_path: Path) -> Iterator[Ward]:
    with Ward(tmp_path, (NAME,)) as made:
        (person,) = PEOPLE
        with made.config.open("a", encoding="utf-8") as file:
            file.write(f'[[dashboard.people]]\nname = "{person.name}"\npassword = "{person.password}"\n')
        yield made


def test_a_ward_from_its_start(ward: Ward, browser: Browser) -> None:
    ward.start("dashboard")
    page = browser.new_page(viewport={"width": 1280, "height": 900}, base_url=f"http://{ward.page}")
    page.set_default_timeout(60_000)
    _open(page, "/")
    expect(page.locator("#troubles")).to_contain_text("router is gone")
    ward.start("router", "estimator", "bridge")
    tile = page.locator(f'.tile[data-id="{NAME}"]')
    expect(tile.locator(".state")).to_contain_text("unknown")
    device = living(NAME, 4)
    ward.plug(NAME, device, speed=5.0, lossless=True)
    expect(page.get_by_role("heading", level=1)).to_have_text("1 of 1 tracking")
    expect(page.locator("#troubles")).to_be_empty()
    tile.get_by_role("link", name=NAME).click()
    page.get_by_text("Signals").click()
    expect(page.locator("#heading")).to_contain_text("By its raw rates alone")
    _as_a_nurse(ward, page)
    OUT.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=OUT / "real-device.png", full_page=True)
    device.reboot()
    expect(page.locator(".rebooted")).to_contain_text("it was switched on: it must be calibrated again")
    page.screenshot(path=OUT / "real-device-rebooted.png", full_page=True)
    expect(page.locator(".state")).to_contain_text("tracking")
    ward.stop("router")
    expect(page.locator("#troubles")).to_contain_text("router is gone")
    ward.start("router")
    expect(page.locator("#troubles")).to_be_empty()
    assert "Traceback" not in ward.log("dashboard")


def _open(page: Page, path: str) -> None:
    """As soon as the dashboard listens."""
    for _ in range(200):
        try:
            page.goto(path)
        except Error:
            page.wait_for_timeout(100)
        else:
            return


def _as_a_nurse(ward: Ward, page: Page) -> None:
    page.get_by_role("link", name="Log in to do more").click()
    page.get_by_label("Name").fill("nurse")
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Log in").click()
    expect(page.get_by_role("button", name="Recalibrate")).to_be_visible()
    page.get_by_role("button", name="Recalibrate").click()
    expect(page.locator("#said").filter(has_text="nurse asked for a new calibration")).to_be_visible()
    page.get_by_role("button", name="Cancel the calibration").click()
    expect(page.locator("#said").filter(has_text="nurse cancelled the calibration")).to_be_visible()
    page.get_by_role("textbox", name="Note").fill("sat up")
    page.get_by_role("button", name="Write it down").click()
    expect(page.locator("#notes")).to_contain_text("sat up")
    done = [("recalibrate", "nurse"), ("cancel", "nurse"), ("note", "nurse")]
    until("estimator", lambda: [(row["verb"], row["who"]) for row in kept(ward, NAME).commands] == done, ward)
