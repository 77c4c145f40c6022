"""Fixtures for all tests."""

import os
import secrets
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# A machine that is busy is no fault of the code. `make soak` sets TRUERATE_SOAK, and draws new examples.
settings.register_profile(
    "unhurried",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=not os.environ.get("TRUERATE_SOAK"),
)
settings.load_profile("unhurried")
# A script's background job ignores Ctrl-C, and `nohup` ignores hang-ups; the processes that the tests start would inherit that.
for number, default in ((signal.SIGINT, signal.default_int_handler), (getattr(signal, "SIGHUP", None), signal.SIG_DFL)):
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, default)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; the test is skipped, saying so, where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the real recordings are not there ({folder})")
    return folder


class Effort:
    """How much to try: a little in `make test`, with the same seed every time; much, and something new, in `make soak`."""

    def __init__(self) -> None:
        self.long = bool(os.environ.get("TRUERATE_SOAK"))
        self.seed = secrets.randbelow(2**31) if self.long else 1

    def __call__(self, short: int, long: int) -> int:
        return long if self.long else short


@pytest.fixture
def effort() -> Effort:
    """A soak prints its seed when it fails."""
    made = Effort()
    print(f"seed {made.seed}")  # noqa: T201
    return made


@pytest.fixture(scope="module")  # while it is open, no other event loop can run in this thread
def browser() -> "Iterator[Browser]":
    """Debian's Chromium; without it the test is skipped, saying so, but under CI=true it fails."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        why = "there is no chromium here; `apt-get install chromium` brings it"
        if os.environ.get("CI") == "true":
            pytest.fail(why)
        pytest.skip(why)
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=60_000)  # a busy machine takes longer than the usual five seconds
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield launched
        launched.close()
