"""Firefox by WebDriver BiDi and WebKit by WebDriver: open a page, ask it something, hear of errors of its scripts."""

import json
import shutil
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import httpx2
from websockets.sync.client import connect

from estimator.demo.ward import free_port

T = TypeVar("T")
_PATIENCE_S = 60.0


class Firefox:
    """Firefox without a screen, with one page. `errors` are those that scripts have written to the console so far."""

    needs = "firefox-esr"

    def __init__(self, folder: Path) -> None:
        port = free_port()
        program = shutil.which("firefox-esr") or "firefox"
        words = [program, "--headless", "--no-remote", "--profile", str(folder), f"--remote-debugging-port={port}"]
        about = {"HOME": str(folder), "PATH": "/usr/bin:/bin", "LANG": "C.UTF-8"}
        self._process = subprocess.Popen(words, env=about, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._numbers, self._errors, self._open = count(1), list[str](), ExitStack()
        self._open.callback(_end, self._process)
        at = f"ws://127.0.0.1:{port}/session"
        self._socket = _soon(lambda: self._open.enter_context(connect(at, max_size=None)))
        self._ask("session.new", capabilities={})
        self._ask("session.subscribe", events=["log.entryAdded"])
        self._page = self._ask("browsingContext.getTree")["contexts"][0]["context"]
        self._ask("browsingContext.setViewport", context=self._page, viewport={"width": 1280, "height": 900})

    @staticmethod
    def there() -> bool:
        return any(map(shutil.which, ("firefox-esr", "firefox")))

    def goto(self, url: str) -> None:
        self._ask("browsingContext.navigate", context=self._page, url=url, wait="complete")

    def evaluate(self, expression: str) -> Any:
        target = {"context": self._page}
        told = self._ask(
            "script.evaluate", expression=f"JSON.stringify({expression})", target=target, awaitPromise=True
        )
        return json.loads(told["result"]["value"])

    def errors(self) -> list[str]:
        self.evaluate("1")  # what was logged before is heard with it
        return self._errors

    def close(self) -> None:
        self._open.close()

    def _ask(self, method: str, **params: Any) -> Any:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while (told := json.loads(self._socket.recv(_PATIENCE_S))).get("id") != number:
            if told.get("method") == "log.entryAdded" and told["params"]["level"] == "error":
                self._errors.append(told["params"]["text"])
        assert told["type"] == "success", told
        return told["result"]


class WebKit:
    """WebKitGTK's MiniBrowser on a screen that nobody sees."""

    needs = "webkit2gtk-driver xvfb"

    def __init__(self, folder: Path) -> None:
        port, self._log = free_port(), folder / "console.log"
        self._screen = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x900x24", "-nolisten", "tcp"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        assert self._screen.stdout is not None
        with self._screen.stdout as said:
            display = said.readline().decode().strip()
        about = {"DISPLAY": f":{display}", "HOME": str(folder), "PATH": "/usr/bin:/bin", "LIBGL_ALWAYS_SOFTWARE": "1"}
        with self._log.open("wb") as out:
            words = ["WebKitWebDriver", f"--port={port}", "--host=127.0.0.1"]
            self._process = subprocess.Popen(words, env=about, stdout=out, stderr=subprocess.STDOUT)
        (browser,) = Path("/usr/lib").glob("*/webkit2gtk-4.1/MiniBrowser")
        wanted = {"binary": str(browser), "args": ["--automation", "--enable-write-console-messages-to-stdout=true"]}
        self._client = httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=_PATIENCE_S)
        _soon(lambda: self._client.get("/status").raise_for_status())
        self._session = ""
        made = self._ask("session", capabilities={"alwaysMatch": {"webkitgtk:browserOptions": wanted}})
        self._session = f"session/{made['sessionId']}/"

    @staticmethod
    def there() -> bool:
        return all(map(shutil.which, ("WebKitWebDriver", "Xvfb")))

    def goto(self, url: str) -> None:
        self._ask("url", url=url)

    def evaluate(self, expression: str) -> Any:
        return self._ask("execute/sync", script=f"return {expression}", args=[])

    def errors(self) -> list[str]:
        said = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        return [line for line in said if "CONSOLE" in line and "ERROR" in line]

    def close(self) -> None:
        self._client.delete(self._session.rstrip("/"))
        self._client.close()
        _end(self._process)
        _end(self._screen)

    def _ask(self, what: str, **params: Any) -> Any:
        answer = self._client.post(f"/{self._session}{what}", json=params)
        assert answer.is_success, answer.text
        return answer.json()["value"]


def _soon(do: Callable[[], T]) -> T:
    """As soon as something listens."""
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return do()
        except (OSError, httpx2.TransportError):
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
