"""`truerate outlet mqtt` against a real mosquitto: rates, retained statuses, a broker that goes and comes, and its refusals."""

import gc
import json
import os
import re
import shutil
import subprocess
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from bridge.bus.embedded_router import Router
from bridge.toml.loader import ConfigError
from estimator.cli.main import main
from estimator.demo.subscribers import Subscriber
from estimator.demo.ward import WARD, Ward, free_port, listens
from estimator.outlets.mqtt.broker import Broker as Session
from estimator.outlets.mqtt.broker import address_of
from tests.ward.parts import add_simulated, until

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(300)]
NAMES = ["chest", "wrist"]
#: Debian puts it where only administrators look
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")


class Broker:
    """A mosquitto on loopback, which keeps what is retained only while it runs."""

    def __init__(self, folder: Path, *settings: str) -> None:
        if MOSQUITTO is None:
            pytest.skip("there is no mosquitto here; `apt-get install mosquitto` brings it")
        self.port = free_port()
        self._file = folder / "mosquitto.conf"
        self._file.write_text(
            f"listener {self.port} 127.0.0.1\nuser {os.environ.get('USER', 'root')}\n" + "\n".join(settings)
        )
        self.start()

    def start(self) -> None:
        assert MOSQUITTO is not None
        self._process = subprocess.Popen([MOSQUITTO, "-c", str(self._file)], stderr=subprocess.DEVNULL)
        assert listens(f"tcp/127.0.0.1:{self.port}", 60.0)

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def broker_with(tmp_path: Path) -> Iterator[Callable[..., Broker]]:
    """Starts brokers with these settings, and ends them."""
    made: list[Broker] = []

    def start(*settings: str) -> Broker:
        made.append(Broker(tmp_path, *settings))
        return made[-1]

    yield start
    for one in made:
        one.stop()


class Reader:
    """An MQTT client that keeps all it is sent, by topic."""

    def __init__(self, port: int) -> None:
        self.got: dict[str, list[Any]] = {}
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = self._take
        self._client.connect("127.0.0.1", port)
        self._client.subscribe("#")
        self._client.loop_start()

    def _take(self, _client: Client, _data: Any, message: Any) -> None:
        text = message.payload.decode()
        self.got.setdefault(message.topic, []).append(json.loads(text) if text.startswith("{") else text)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


def test_rates_and_statuses_also_after_the_broker_was_away(tmp_path: Path, broker_with: Callable[..., Broker]) -> None:
    broker = broker_with("allow_anonymous true")
    with Ward(tmp_path, ()) as ward:
        add_simulated(ward, NAMES, 1.0)
        ward.add("mqtt", "outlet", "mqtt", f"mqtt://127.0.0.1:{broker.port}", "--config", str(ward.config))
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        subscriber = Subscriber(ward.endpoint, WARD, keep=True)
        ward.start("mqtt")
        reader = Reader(broker.port)
        top = f"truerate/{WARD}"
        until("mqtt", lambda: all(len(reader.got.get(f"{top}/{name}/rate", ())) >= 3 for name in NAMES), ward)
        late = Reader(broker.port)  # what is retained comes first
        until("mqtt", lambda: all(f"{top}/{name}/status" in late.got for name in NAMES), ward)
        assert late.got[f"{top}/outlet"] == ["online"]
        assert late.got[f"{top}/chest/status"][0]["reason"][0]["text"]
        late.close()
        reader.close()
        subscriber.close()

        rates = reader.got[f"{top}/chest/rate"]
        assert all(one["samples"] in range(100, 110) for one in rates), "one a second, of 104 samples"
        batches = [batch for (device, _), held in subscriber.batches.items() if device == "chest" for batch in held]
        numbers = np.concatenate([batch.sequence + np.arange(len(batch)) for batch in batches])
        sent = np.concatenate([batch.rate for batch in batches])
        for one in rates:
            kept = (numbers > one["sequence"] - one["samples"]) & (numbers <= one["sequence"])
            assert one["rate"] == pytest.approx(sent[kept].mean(axis=0), abs=1e-6)
            assert one["rate_max"] == pytest.approx(sent[kept].max(axis=0), abs=1e-6)
            assert all(value > 0 for value in one["rate_std"])

        broker.stop()
        until("mqtt", lambda: "trying again" in ward.log("mqtt"), ward)
        broker.start()
        reader = Reader(broker.port)
        until(
            "mqtt",
            lambda: (
                {f"{top}/outlet", *(f"{top}/{name}/{what}" for name in NAMES for what in ("rate", "status"))}
                <= reader.got.keys()
            ),
            ward,
        )
        ward.stop("mqtt")
        until("mqtt", lambda: reader.got[f"{top}/outlet"][-1] == "offline", ward)
        reader.close()
        assert not ward.complaints


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Of a router."""
    one = f"tcp/127.0.0.1:{free_port()}"
    with Router([one]):
        yield one


Refused = Callable[..., tuple[int, str]]


@pytest.fixture
def refused(endpoint: str, capsys: pytest.CaptureFixture[str]) -> Refused:
    """Exit code and the last line on standard error of an outlet with these words."""

    def told(*words: str) -> tuple[int, str]:
        with warnings.catch_warnings():  # paho leaves the socket of a failed handshake to the garbage collector
            warnings.simplefilter("ignore", ResourceWarning)
            code = main(["outlet", "mqtt", *words, "--ward", "w", "--connect", endpoint])
            gc.collect()
        return code, capsys.readouterr().err.splitlines()[-1]

    return told


def test_a_broker_that_refuses(tmp_path: Path, refused: Refused, broker_with: Callable[..., Broker]) -> None:
    free = free_port()
    assert refused(f"mqtt://127.0.0.1:{free}") == (
        1, f"truerate: broker 127.0.0.1:{free}: connection refused; check the address, and that the broker is running",
    )  # fmt: skip
    passwords, wrong = tmp_path / "passwords", tmp_path / "wrong"
    passwords.touch(0o600)
    wrong.write_text("wrong\n")
    subprocess.run(["mosquitto_passwd", "-b", passwords, "ward", "right"], check=False)
    broker = broker_with(f"password_file {passwords}")
    code, said = refused(f"mqtt://ward@127.0.0.1:{broker.port}", "--password-file", str(wrong))
    assert (code, said) == (
        1, f"truerate: broker 127.0.0.1:{broker.port} refuses user ward: check USER in the URL and --password-file",
    )  # fmt: skip
    code, said = refused(f"mqtts://127.0.0.1:{broker.port}")
    assert code == 1
    assert "does not speak TLS on this port: use mqtt://" in said


def test_tls_trusts_the_named_authority_only(
    tmp_path: Path, refused: Refused, broker_with: Callable[..., Broker]
) -> None:
    made = [
        "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
        "-subj", "/CN=127.0.0.1",
        "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(tmp_path / "key.pem"), "-out", str(tmp_path / "ca.pem"),
    ]  # fmt: skip
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl here; `apt-get install openssl` brings it")
    subprocess.run(made, check=True, capture_output=True)
    broker = broker_with("allow_anonymous true", f"certfile {tmp_path / 'ca.pem'}", f"keyfile {tmp_path / 'key.pem'}")
    url = f"mqtts://127.0.0.1:{broker.port}"
    code, said = refused(url)
    assert code == 1
    assert "shows a certificate that is not trusted" in said
    assert "?ca=FILE" in said
    with Session(address_of(f"{url}?ca={tmp_path / 'ca.pem'}", ""), None, "p") as session:
        assert session.publish("t", b"{}")


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("host", "the broker's address is 'host': write for example mqtt://127.0.0.1"),
        (
            "mqtt://a:b@host",
            "the broker's address holds a password: put the password into a file, and name the file with --password-file",
        ),
        ("mqtt://host?ca=x", "TLS is needed for ca: write mqtts://"),
    ],
)
def test_wrong_addresses(url: str, told: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(told)):
        address_of(url, "")


def test_wrong_words(refused: Refused) -> None:
    for words, told in (
        (["mqtts://host?ca=/none/ca.pem"], "there is no such file"),
        (["mqtt://host", "--password-file", "/none/p"], "--password-file /none/p: there is no such file"),
        (["mqtt://host", "--topic", "a/#"], "--topic is 'a/#'"),
    ):
        code, said = refused(*words)
        assert (code, told in said) == (2, True), said


def test_without_the_package(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("estimator.cli.outlet.find_spec", lambda _: None)
    assert main(["outlet", "mqtt", "mqtt://host"]) == 2
    assert "truerate outlet mqtt needs another package: pip install 'truerate[mqtt]'" in capsys.readouterr().err
