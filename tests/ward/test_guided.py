"""A guided calibration on a ward of real processes, with the page alone and beside it in a terminal: how long it takes."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from bridge.sim.imperfection import DEMO_SPEC
from bridge.sim.motion import Motion, Piece, Still
from bridge.sim.script import SessionPlan, flat, session, worn
from bridge.sim.source import SimulatedSource
from bridge.sim.virtual_device import VirtualDevice
from estimator.demo.ward import Ward
from tests.ward.parts import WAITING
from tests.ward.test_dashboard import _open
from tests.web.conftest import OUT

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(300)]
NAME = "wrist"
#: how much faster than life the device lives
SPEED = 2.0


def handled(rng: np.random.Generator) -> Motion:
    """Worn, then put on the table, turned once about each axis, and worn again."""

    def pieces() -> Iterator[Piece]:
        yield Still(4.0)
        yield from session(rng, SessionPlan(3.4, None, (3.5, 5.0), 2.0, 3.0, 0.2))
        yield from worn(rng)

    return Motion(pieces(), flat(rng))


def test_from_an_open_page_to_the_verdict(tmp_path: Path, browser: Browser) -> None:
    expect.set_options(timeout=60_000)
    with Ward(tmp_path, (NAME,)) as ward:
        ward.start("router", "estimator", "bridge", "dashboard")
        page = browser.new_page(base_url=f"http://{ward.page}")
        _open(page, "/")
        expect(page.locator(".tile")).to_have_count(1)
        # A stopwatch of the device's own time: from the page's first sight of it to the verdict.
        device = VirtualDevice(NAME, SimulatedSource(handled, DEMO_SPEC, 104.0), 4, WAITING)
        page.goto(f"/devices/{NAME}/calibrate")
        expect(page.locator("#do")).to_have_text("Nothing is heard of it")
        page.evaluate(STOPWATCH)
        words = [sys.executable, "-m", "estimator.cli", "calibrate", "--live", NAME, "--config", str(ward.config)]
        told = tmp_path / "terminal"
        with told.open("wb") as out:
            terminal = subprocess.Popen(
                [*words, "--lang", "en", "--seconds", "100"], stdout=out, stdin=subprocess.DEVNULL
            )
        while not told.stat().st_size:  # it says that nothing is heard of it: it listens
            time.sleep(0.05)
            assert terminal.poll() is None
        ward.plug(NAME, device, speed=SPEED, lossless=True)
        expect(page.locator("#do")).to_have_text("Done: it is calibrated")
        expect(page.locator("#rows tr")).to_have_count(3)
        seen = page.evaluate("window.seen")
        OUT.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=OUT / "real-guide-done.png", full_page=True)
        page.get_by_role("link", name="Certificate, to print").click()
        expect(page.locator(".verdict")).to_contain_text(f"{NAME}: accepted")
        assert page.locator(".figure").evaluate("picture => picture.decode().then(() => picture.naturalWidth)") > 1000
        page.screenshot(path=OUT / "real-certificate.png", full_page=True)
        assert "Traceback" not in ward.log("dashboard")
        assert terminal.wait(60) == 0
    lines = told.read_text(encoding="utf-8")
    assert "Turn it round once, flat on the table" in lines
    assert lines.index("Put it at the edge of the table, and let go") < lines.index("Done: it is calibrated")
    steps = [step for _, step in seen]
    # Each turn is asked for, followed and let rest, and nothing else is said between.
    assert [steps.count(step) for step in ("turn", "turning", "settle", "done")] == [3, 3, 3, 1], seen
    print(f"from plugging it in to the verdict: {SPEED * seen[-1][0]:.0f} s of the device's time")  # noqa: T201


STOPWATCH = """{
  const page = document.querySelector(".guide"), begin = performance.now();
  window.seen = [];
  new MutationObserver(() => {
    const step = page.dataset.step;
    if (window.seen.at(-1)?.[1] !== step) window.seen.push([(performance.now() - begin) / 1000, step]);
  }).observe(page, { attributes: true, attributeFilter: ["data-step"] });
}"""
