"""Requests that cost a lot to answer: nobody else waits for them, and nothing is done that nobody waits for."""

import asyncio
import gc
import socket
import threading
import time
import urllib.request
from dataclasses import replace
from http import HTTPStatus
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from starlette.requests import Request

from bridge.wire.messages import Calibration
from estimator.service.history import Biases, History
from estimator.service.store import Store
from estimator.service.store_reader import StoreReader
from estimator.web import report_pages
from estimator.web.http_error import Fault
from estimator.web.shared_work import WAITING, SharedWork
from estimator.web.ward_state import CALIBRATIONS
from tests.estimator.device.test_correction import CALIBRATION
from tests.web.asking import Asking, error
from tests.web.conftest import Site, served
from tests.web.talk import said, until


def test_an_address_beyond_its_bound_is_refused_at_once(asking: Asking) -> None:
    assert error(asking.client.get("/api/v1/devices", params={"x": "[" * 15_000})) == (414, "too_long")
    assert asking.client.get(f"/{'x' * 9000}").status_code == 414


def test_answers_to_programs_are_not_compressed(asking: Asking) -> None:
    asked = {path: asking.client.get(path).headers for path in ("/api/v1/openapi.json", "/")}
    assert all(int(headers["content-length"]) > 2000 for headers in asked.values())
    assert [headers.get("content-encoding") for headers in asked.values()] == [None, "gzip"]


class Left:
    """A client of a request: it is there until it leaves."""

    def __init__(self) -> None:
        self.left = asyncio.Event()
        self.request = Request({"type": "http"}, self._receive)

    async def _receive(self) -> dict[str, str]:
        await self.left.wait()
        return {"type": "http.disconnect"}


def test_equal_requests_share_an_answer_and_what_nobody_waits_for_is_not_made() -> None:
    made, may_end = list[str](), threading.Event()

    def make(key: str) -> str:
        may_end.wait(60)
        made.append(key)
        return key

    async def ask() -> None:
        work = SharedWork[str](60.0)
        clients = [Left() for _ in range(WAITING)]
        asked = [
            asyncio.create_task(work.get(one.request, f"{n}", lambda n=n: make(f"{n}")))  # type: ignore[misc]
            for n, one in enumerate(clients)
        ]
        same = asyncio.create_task(work.get(Left().request, "0", lambda: make("0 again")))
        await asyncio.sleep(0)  # all of them ask
        with pytest.raises(Fault) as full:
            await work.get(Left().request, "more", lambda: make("more"))
        assert full.value.status is HTTPStatus.SERVICE_UNAVAILABLE
        for one in clients[1:]:
            one.left.set()
        assert {type(one) for one in await asyncio.gather(*asked[1:], return_exceptions=True)} == {Fault}
        more = asyncio.create_task(work.get(Left().request, "more", lambda: make("more")))
        may_end.set()
        assert list(await asyncio.gather(asked[0], same, more)) == ["0", "0", "more"]
        assert await work.get(Left().request, "0", lambda: make("late")) == "0"

    asyncio.run(ask())
    assert made == ["0", "more"]


def test_abandoned_pictures_are_not_drawn(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, may_end = list[str](), threading.Event()

    def slowly(of: object, **_: bool) -> bytes:
        may_end.wait(60)
        drawn.append(of.device)  # type: ignore[attr-defined]
        return b"png"

    monkeypatch.setattr(report_pages, "_drawn", slowly)
    site.talk.hush()  # what is said again would be more points
    now_ns = time.time_ns()
    for n in range(30):
        for second in (0, 1):
            site.talk(said(f"d{n:02d}", boot=5, time_ns=now_ns + second * 10**9))
    stories = site.server.desk.known.stories
    until(lambda: len(stories) == 30 and all(len(story.trail.points) == 2 for story in stories.values()))
    get, ended = site.server.desk.pictures.get, list[bool]()

    async def counted(*asked: Any) -> bytes:
        try:
            return await get(*asked)
        finally:
            ended.append(True)

    monkeypatch.setattr(site.server.desk.pictures, "get", counted)
    port = int(site.url.rpartition(":")[2])
    for n in range(120):
        with socket.create_connection(("127.0.0.1", port), 60) as asks:
            asks.sendall(f"GET /devices/d{n % 30:02d}/bias.png HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    until(lambda: len(ended) >= 120)
    may_end.set()
    with urllib.request.urlopen(f"{site.url}/devices/d29/bias.png", timeout=60) as answer:
        assert answer.read() == b"png"
    assert len(drawn) <= WAITING


def test_a_drawn_picture_leaves_no_figure_in_memory() -> None:
    points = Biases("5", np.arange(3) * 10**9, np.zeros((3, 3)), np.ones((3, 3)), np.full(3, 25.0))
    drawn = report_pages._drawn(History("chest", (), (), (), (points,)), dark=False, narrow=False)
    assert drawn.startswith(b"\x89PNG")
    assert not [thing for thing in gc.get_objects() if isinstance(thing, Figure)]


def test_a_stored_list_is_read_once_for_many_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "ward.sqlite3")
    for n in range(CALIBRATIONS + 5):
        store.add_calibration(replace(CALIBRATION, device="chest", boot=5, id=f"c{n:03}", time_ns=10**18 + n))
    store.close()
    read = list[str]()
    calibrations = StoreReader.calibrations

    def counted(own: StoreReader, name: str) -> list[Calibration]:
        read.append(name)
        return calibrations(own, name)

    monkeypatch.setattr(StoreReader, "calibrations", counted)
    site = served(store=tmp_path / "ward.sqlite3")
    site.talk(said("chest", boot=5))
    until(lambda: "chest" in site.server.desk.known.stories)
    for _ in range(10):
        with urllib.request.urlopen(f"{site.url}/api/v1/devices/chest/calibrations", timeout=60) as answer:
            assert answer.status == 200
    site.stop()
    assert len(read) == 1
