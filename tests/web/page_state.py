"""Waits for the state of a page in a browser."""

import time
from typing import Any

from playwright.sync_api import Page


def wait_for(page: Page, expression: str, arg: Any = None, patience_s: float = 60.0) -> None:
    """Ask the page until the JavaScript expression, or function of `arg`, is true.

    Playwright's own wait_for_function asks from within the page, whose content security policy forbids that.
    """
    deadline = time.monotonic() + patience_s
    while not page.evaluate(expression, arg):
        assert time.monotonic() < deadline, f"never true: {expression}"
        page.wait_for_timeout(20)
