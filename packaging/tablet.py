"""Two tablets in Chromium that trust the ward's authority: the nurse calibrates on one, and the other follows to the end.

Then the administrator adds a person. check.py runs this in the network of the machine that it installed. It prints a line
when the device is to be turned. Needs Debian's packages chromium and libnss3-tools.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Error, Page, Playwright, expect, sync_playwright

#: longest wait for a text on a page: a calibration takes half a minute
PATIENCE_MS = 120_000


def main(url: str, address: str, authority: str, device: str, nurse: str, chief: str) -> int:
    """Use the page at a URL. address: of its host. authority: certificate file. nurse, chief: their passwords."""
    expect.set_options(timeout=PATIENCE_MS)
    with tempfile.TemporaryDirectory() as home, sync_playwright() as playwright:
        stranger = _tablet(playwright, url, address, home)
        try:
            stranger.goto(url)
            said = "the page"
        except Error as error:
            said = str(error)
        if "ERR_CERT_AUTHORITY_INVALID" not in said:
            raise SystemExit(f"without trust in the authority the browser got {said}, not ERR_CERT_AUTHORITY_INVALID")
        _trust(authority, Path(home) / ".pki/nssdb")
        first, second = (_tablet(playwright, url, address, home) for _ in range(2))
        _log_in(first, url, "nurse", nurse)
        first.get_by_role("link", name=device, exact=True).click()
        first.get_by_role("link", name="Calibrate, step by step").click()
        second.goto(first.url)
        first.get_by_role("button", name="Calibrate it again").click()
        expect(second.locator("#do")).not_to_have_text("Done: it is calibrated")
        print("turn the device", flush=True)
        for page in (first, second):
            expect(page.locator("#do")).to_have_text("Done: it is calibrated")
        first.get_by_role("button", name="Log out").click()
        _log_in(first, url, "chief", chief)
        first.get_by_role("link", name="People").click()
        first.get_by_label("Name").fill("joy")
        first.get_by_role("button", name="Add a person").click()
        expect(first.locator("#link")).to_contain_text(f"{url}welcome?key=")
        print(" ".join(second.locator("#rows tr").first.inner_text().split()), flush=True)
    return 0


def _tablet(playwright: Playwright, url: str, address: str, home: str) -> Page:
    host = url.split("/")[2].rpartition(":")[0]
    words = ["--no-sandbox", f"--host-resolver-rules=MAP {host} {address}"]
    environ: dict[str, str | float | bool] = {**os.environ, "HOME": home}
    return playwright.chromium.launch(executable_path="/usr/bin/chromium", args=words, env=environ).new_page()


def _log_in(page: Page, url: str, name: str, password: str) -> None:
    page.goto(url)
    page.get_by_role("link", name="Log in").click()
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Log in").click()


def _trust(authority: str, database: Path) -> None:
    database.mkdir(parents=True, exist_ok=True)
    for words in (["-N", "--empty-password"], ["-A", "-t", "C,,", "-n", "ward", "-i", authority]):
        subprocess.run(["certutil", "-d", f"sql:{database}", *words], check=True)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
