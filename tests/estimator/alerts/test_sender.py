"""Alerts sent by apprise to a server on this machine: one message for many devices, and no password in an error."""

import json
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from bridge.toml.loader import ConfigError, load
from bridge.wire.messages import Alert, Placement
from estimator.alerts import outbox
from estimator.alerts.board import Change
from estimator.alerts.sender import Sender, by_apprise
from estimator.config.alerts import Alerts
from estimator.config.schema import Ward

#: apprise imports what Python 3.13 does not have
pytestmark = pytest.mark.filterwarnings("ignore:'(imghdr|cgi)' is deprecated:DeprecationWarning")
LOST = Change(Alert("lost", 10**18, 10**18 + 60))


class Hook:
    """A webhook's server, and what it was told."""

    def __init__(self) -> None:
        self.told: list[dict[str, str]] = []
        told = self.told

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                told.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"json://127.0.0.1:{self.server.server_port}/"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def hook() -> Iterator[Hook]:
    pytest.importorskip("apprise")
    made = Hook()
    yield made
    made.server.shutdown()
    made.server.server_close()


def test_a_ward_that_is_lost_is_one_message(hook: Hook, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "GATHER_S", 0.3)
    (file := tmp_path / "urls").write_text(f"# to the desk\n{hook.url}\n")
    made = Sender("w", Alerts())
    made.use(Alerts(urls_file=str(file), language="zh"))  # the ward file is changed
    for n in range(20):
        made.put(f"d{n}", Placement("humerus", "left", "bed-3"), LOST)
    until = time.monotonic() + 60
    while not hook.told and time.monotonic() < until:
        time.sleep(0.05)
    made.close()
    (one,) = hook.told
    assert one["title"] == "w: ! 20"
    assert one["message"].count("收不到该设备") == 20
    assert "d7 (humerus left, bed-3)" in one["message"]


def test_addresses_come_from_file_and_environment_and_stay_secret(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRUERATE_ALERT_URLS", "json://127.0.0.1:1/ nonsense://user:secret@host")
    pytest.importorskip("apprise")
    with pytest.raises(ConfigError, match="begin with nonsense://") as caught:
        Sender("w", Alerts())
    assert "secret" not in str(caught.value)
    with pytest.raises(ConfigError, match=r"urls_file .*nowhere cannot be read"):
        Alerts(urls_file=str(tmp_path / "nowhere")).urls()


def test_without_apprise_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "apprise", None)
    with pytest.raises(ConfigError, match=r"pip install 'truerate\[alerts\]'"):
        by_apprise(["json://127.0.0.1:1/"])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("hold_s = { losst = 3 }", "unknown alert 'losst'.*lost"),
        ("hold_s = { lost = -1 }", "0 to 604800"),
        ("clear_s = 0", "1 to 86400"),
        ('quiet_hours = "22-6"', "write for example '22:00-06:00'"),
        ('language = "fr"', "'en' or 'zh'"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path: Path, line: str, words: str) -> None:
    (file := tmp_path / "ward.toml").write_text(f'ward = "w"\n[alerts]\n{line}\n')
    with pytest.raises(ConfigError, match=words):
        load(file, Ward)
