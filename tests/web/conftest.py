"""A dashboard of a ward in memory; a real one on a port of its own, and Chromium before it."""

import asyncio
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Dialog, Page, Request

from estimator.config.dashboard import Dashboard, Person
from estimator.demo.ward import free_port
from estimator.web.serve import Server
from tests.estimator.device.test_correction import CALIBRATION
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.web import page_state
from tests.web.asking import PEOPLE, Asking
from tests.web.talk import WARD, Talk, about, said

OUT = Path(__file__).parents[2] / "out" / "screenshots"
AXE = (Path(__file__).parent / "vendor" / "axe.min.js").read_text(encoding="utf-8")
SERIOUS = ("serious", "critical")


@dataclass(slots=True)
class Site:
    """A dashboard that runs: its address, the ward that talks to it, and the bus it hears by."""

    url: str
    talk: Talk
    server: Server
    buses: tuple[MemoryBus, MemoryBus]
    stop: Callable[[], None]


def served(people: tuple[Person, ...] = PEOPLE, store: Path | None = None, **settings: Any) -> Site:
    """A dashboard in a thread, connected; ended by `stop`."""
    broker, port = MemoryBroker(), free_port()
    talk = Talk(broker)
    server = Server(WARD, Dashboard(listen=f"127.0.0.1:{port}", people=people, **settings), store)
    buses = MemoryBus(broker), MemoryBus(broker)

    async def serve() -> None:
        server.connect(*buses)
        await server.serve()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    while not server.uvicorn.started:
        time.sleep(0.01)
        assert thread.is_alive(), "the dashboard did not start"

    def stop() -> None:
        talk.hush()
        server.stop()
        thread.join(10)

    return Site(f"http{'s' * ('certificate' in settings)}://127.0.0.1:{port}", talk, server, buses, stop)


@pytest.fixture
def asking() -> Iterator[Asking]:
    """A dashboard in this process that has heard of one device."""
    made = Asking()
    with made.client:
        made.hear(about("chest", boot=5), said("chest", boot=5, time_ns=time.time_ns(), calibration=CALIBRATION.id))
        yield made
    made.talk.hush()


@pytest.fixture
def site() -> Iterator[Site]:
    """One of its own for each test."""
    made = served()
    yield made
    made.stop()


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    """A page of 1280 by 900 whose errors, requests elsewhere and broken policies fail the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, base_url=site.url)
    made = context.new_page()
    wrong: list[str] = []

    def elsewhere(request: Request) -> None:
        if not request.url.startswith(site.url):
            wrong.append(f"asked {request.url}")

    def told(message: ConsoleMessage) -> None:
        if message.type == "error":
            wrong.append(message.text)

    def asked(dialog: Dialog) -> None:
        wrong.append(f"a dialog: {dialog.message}")
        dialog.dismiss()

    made.on("pageerror", lambda error: wrong.append(str(error)))
    made.on("console", told)
    made.on("dialog", asked)
    made.on("request", elsewhere)
    yield made
    context.close()
    unexpected = [words for words in wrong if "Failed to load resource" not in words and "WebSocket" not in words]
    assert unexpected == []


class Look:
    """Looks at the page as it is: axe finds nothing serious, by day on a wide screen and by night on a narrow one.

    Where TRUERATE_PICTURES asks for it, a picture of each is kept.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._pictures = page, bool(os.environ.get("TRUERATE_PICTURES"))
        if self._pictures:
            OUT.mkdir(parents=True, exist_ok=True)

    def __call__(self, name: str = "", *, axe: bool = True) -> None:
        """Look; name: of the pictures, if any are to be kept. axe: False only keeps pictures."""
        page, size = self._page, self._page.viewport_size
        ways: tuple[tuple[Literal["light", "dark"], int, int], ...] = (("light", 1280, 900), ("dark", 320, 900))
        for scheme, width, height in ways if axe or self._pictures else ():
            page.emulate_media(color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": height})
            page_state.wait_for(page, f"document.documentElement.scrollWidth <= {width}")  # charts follow a frame later
            if self._pictures and name:
                page.screenshot(path=OUT / f"{name}-{scheme}-{width}.png", full_page=width == 320)
            if axe:
                page.evaluate(AXE)
                found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
                wrong = {
                    one["id"]: [node["html"] for node in one["nodes"]][:3] for one in found if one["impact"] in SERIOUS
                }
                assert not wrong, f"{scheme} {width}: {wrong}"
        if size is not None:
            page.set_viewport_size(size)


@pytest.fixture
def look(page: Page) -> Look:
    """Looks at the test's page."""
    return Look(page)
