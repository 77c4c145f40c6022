"""From the ward page to a calibrated device, by what the pages say alone: how long somebody new takes. `make bench`.

Router, bridge, estimator and dashboard are processes, the device lives in real time, and the hand reads Chromium's page.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from playwright.sync_api import Browser, expect, sync_playwright
from rich.console import Console

from estimator.calibration.stages import REST_S
from estimator.demo.ward import Ward
from tests.ward.hand import Hand, Table
from tests.ward.test_dashboard import _open

NAME, _CHROMIUM = "wrist", "/usr/bin/chromium"
#: to take in a page, or a step that is new, before a hand moves; to turn it takes 3.5 to 5 s
_READS_MS = 2000.0


#: turns that are made by half, by the picture that is shown
_MISTAKES = ("", "along", "flat,along,across,along")


class Spent(NamedTuple):
    """Seconds from plugging a device in to the verdict; of these the hand's own, and the rests that each turn needs."""

    took: float
    reading: float
    turning: float
    resting: float

    def __str__(self) -> str:
        else_s = self.took - self.reading - self.turning - self.resting
        return (
            f"{self.took:.0f} s: reading {self.reading:.0f}, turning {self.turning:.0f}, resting {self.resting:.0f}, "
            f"waiting for programs {else_s:.0f}"
        )


def calibrated(browser: Browser, seed: int, *, half: str) -> Spent:
    """From the ward page to the verdict; turns at these pictures are first made by half."""
    with tempfile.TemporaryDirectory() as folder, Ward(Path(folder), (NAME,)) as ward:
        ward.start("router", "estimator", "bridge", "dashboard")
        context = browser.new_context(base_url=f"http://{ward.page}", viewport={"width": 820, "height": 1180})
        page = context.new_page()
        _open(page, "/")
        expect(page.locator(".tile")).to_have_count(1)
        table = Table(NAME, seed)
        begin = time.monotonic()
        ward.plug(NAME, table.device)
        hand = Hand(page, table, _READS_MS)
        hand.from_the_ward_page(NAME)
        hand.follow(half=half)
        took_s = time.monotonic() - begin
        expect(page.locator("#do")).to_have_text("Done: it is calibrated")
        context.close()
    rests = len(table.turned_s) + 1
    return Spent(took_s, hand.read_s, sum(table.turned_s), rests * REST_S)


def main() -> int:
    """Print it; no verdict."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=int, default=3)
    given = parser.parse_args()
    console = Console()
    expect.set_options(timeout=60_000)
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        for half in _MISTAKES:
            for seed in range(given.times):
                how = f"{len(half.split(','))} turns by half and repeated" if half else "each turn right"
                console.print(f"from the ward page to the verdict, {how}: {calibrated(browser, seed, half=half)}")
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
