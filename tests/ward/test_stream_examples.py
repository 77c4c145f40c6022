"""The programs of docs/examples read a virtual ward: every sample once, also while the dashboard is restarted.

A program is skipped where its tool is not installed, unless TRUERATE_NODE=required (as in .ci/run).
"""

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from estimator.demo.subscribers import Subscriber
from estimator.demo.ward import WARD, Ward, free_port
from tests.ward.parts import add_simulated
from tests.web import page_state

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(240)]
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
NAMES = ["chest", "wrist-left"]
#: how many samples a program reads; at four times real time, while the dashboard is away and back
SAMPLES = 2000
PROGRAMS = ["stream.mjs", "stream.cpp", "stream.m"]
PAGE = free_port()


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ward]:
    with Ward(tmp_path_factory.mktemp("ward"), ()) as made:
        add_simulated(made, NAMES, speed=4.0)
        with made.config.open("a", encoding="utf-8") as file:
            file.write(f'origins = ["http://localhost:{PAGE}"]\n')
        made.start("router", "bridge", "estimator", "dashboard")
        made.wait_for_router()
        yield made


@pytest.fixture(scope="module")
def heard(ward: Ward) -> Iterator[Subscriber]:
    """What Python's client gets meanwhile."""
    subscriber = Subscriber(ward.endpoint, WARD, keep=True)
    while "chest" not in {device for device, _ in subscriber.received.copy()}:
        time.sleep(0.05)
    yield subscriber
    subscriber.close(0.1)


def program(name: str, folder: Path) -> list[str] | str:
    """Command line of an example, compiled if need be; or why it cannot run here."""
    if name == "stream.mjs":
        return ["node", str(EXAMPLES / name)] if shutil.which("node") else "node (Debian: apt-get install nodejs)"
    if name == "stream.m":
        found = shutil.which("octave-cli")
        return [found, str(EXAMPLES / name)] if found else "octave-cli (Debian: apt-get install octave)"
    built = folder / "stream"
    if built.exists():
        return [str(built)]
    if shutil.which("g++") is None:
        return "g++ (Debian: apt-get install g++)"
    words = ["g++", "-O1", str(EXAMPLES / name), "-o", str(built), "-lcurl"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if "No such file" in done.stderr or "cannot find -lcurl" in done.stderr:
        return "libcurl or nlohmann/json (Debian: apt-get install libcurl4-openssl-dev nlohmann-json3-dev)"
    assert done.returncode == 0, done.stderr
    return [str(built)]


def runnable(name: str, ward: Ward) -> list[str]:
    """Command line of an example; the test is skipped, or fails under TRUERATE_NODE=required, where it cannot run."""
    words = program(name, ward.folder)
    if isinstance(words, list):
        return words
    if os.environ.get("TRUERATE_NODE") == "required":
        pytest.fail(f"not installed: {words}")
    pytest.skip(f"not installed: {words}")


@pytest.fixture(scope="module")
def printed(ward: Ward, heard: Subscriber) -> dict[str, tuple[int, list[str]]]:
    """Exit code and lines of each program that can run here; the dashboard is restarted once all of them read."""
    with ExitStack() as stack:
        runs = {}
        for name in PROGRAMS:
            if isinstance(words := program(name, ward.folder), str):
                continue
            words = [*words, f"http://{ward.page}", "chest", f"{SAMPLES}"]
            runs[name] = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        lines = {name: [run.stdout.readline()] for name, run in runs.items() if run.stdout}
        ward.stop("dashboard")
        ward.start("dashboard")
        for name, run in runs.items():
            assert run.stdout is not None
            lines[name] += run.stdout.readlines()
        return {name: (run.wait(), lines[name]) for name, run in runs.items()}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_has_every_sample_once(
    name: str, printed: dict[str, tuple[int, list[str]]], ward: Ward, heard: Subscriber
) -> None:
    runnable(name, ward)
    code, lines = printed[name]
    assert code == 0
    number, _, *rates = np.array([line.split(",")[1:] for line in lines], float).T
    assert {line.split(",")[0] for line in lines} == {"chest"}
    np.testing.assert_array_equal(np.diff(number), 1)
    assert len(number) >= SAMPLES
    known: dict[int, Any] = {}
    for (device, _), batches in heard.batches.copy().items():
        for batch in batches if device == "chest" else ():
            known |= dict(zip(range(batch.sequence, batch.sequence + len(batch)), batch.rate, strict=True))
    mine = [row for row, n in enumerate(number.astype(int)) if n in known]
    assert len(mine) > SAMPLES // 2
    np.testing.assert_allclose(np.transpose(rates)[mine], [known[int(number[row])] for row in mine], rtol=1e-6)


@pytest.mark.parametrize("name", ["stream.mjs", "stream.cpp"])
def test_a_program_says_what_is_wrong(name: str, ward: Ward) -> None:
    ran = subprocess.run(
        [*runnable(name, ward), f"http://{ward.page}", "nobody"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ran.returncode == 1
    assert ran.stderr.startswith("No device nobody was heard. Devices there are: chest")


def test_a_page_elsewhere_shows_the_ward(ward: Ward, heard: Subscriber, browser: Browser) -> None:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("localhost", PAGE), partial(Quiet, directory=str(EXAMPLES)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    page = browser.new_page()
    page.goto(f"http://localhost:{PAGE}/stream.html?url=http://{ward.page}&hz=50")
    for name in NAMES:
        expect(page.locator(f"#of-{name}")).to_be_visible()
    ward.stop("dashboard")
    expect(page.locator("#said")).to_contain_text("not connected")
    before = int(page.locator("#of-chest td").nth(6).inner_text())
    ward.start("dashboard")
    expect(page.locator("#said")).to_have_text("connected")
    page_state.wait_for(page, f"Number(document.querySelector('#of-chest').cells[6].textContent) > {before + 50}")
    page.goto(f"http://localhost:{PAGE}/stream.html?url=http://{ward.page}&device=nobody")
    expect(page.locator("#said")).to_contain_text("No device nobody was heard")
    page.close()
    server.shutdown()
    server.server_close()
