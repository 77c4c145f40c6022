"""A ward as whoever runs it sees it, with real processes: health, status, a graceful stop, a store that is damaged."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from bridge.wire.messages import State
from estimator.cli.main import main
from estimator.database import back_up
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward, free_port
from estimator.service.store import Store
from tests.bridge.asking import get
from tests.ward.parts import living, numbers, wait

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(240)]
NAME = "wrist"


@dataclass
class Running:
    """A ward with one calibrated device, and the ports of its health."""

    ward: Ward
    watcher: Watcher
    bridge_port: int
    estimator_port: int

    @property
    def store(self) -> Path:
        return self.ward.folder / "truerate.sqlite3"

    def status(self, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, object]]:
        capsys.readouterr()
        code = main(["status", "--config", str(self.ward.config), "--json"])
        return code, json.loads(capsys.readouterr().out)

    def until_said(
        self, capsys: pytest.CaptureFixture[str], what: str, right: Callable[[int, dict[str, object]], bool]
    ) -> tuple[int, dict[str, object]]:
        """The first status that is right."""
        said = list[tuple[int, dict[str, object]]]()

        def asked() -> bool:
            said.append(self.status(capsys))
            return right(*said[-1])

        wait(what, asked, self.watcher, self.ward)
        return said[-1]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with Ward(tmp_path, (NAME,)) as ward:
        ports = free_port(), free_port()
        text = ward.config.read_text(encoding="utf-8")
        for name, port in zip(("bridge-1", "estimator-1"), ports, strict=True):
            text = text.replace(f'id = "{name}"', f'id = "{name}"\nhealth = "127.0.0.1:{port}"')
        ward.config.write_text(text, encoding="utf-8")
        ward.start("estimator")
        deadline = time.monotonic() + 60
        while "trying again until a router answers" not in ward.log("estimator") and time.monotonic() < deadline:
            time.sleep(0.05)
        assert get(ports[1], "/healthz") == (200, "ok\n"), "it lives while it waits for a router"
        assert get(ports[1], "/readyz") == (503, "no router yet\n")
        ward.start("router", "bridge")
        ward.wait_for_router()
        watcher = Watcher(ward.endpoint, WARD)
        ward.plug(NAME, living(NAME, seed=3), speed=10.0, lossless=True)
        try:
            wait("a calibration", lambda: watcher.all_tracking(1), watcher, ward)
            yield Running(ward, watcher, *ports)
        finally:
            watcher.close()


def test_a_wards_health_its_graceful_stop_a_damaged_store_and_what_is_missing(
    running: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    it_is_well(running, capsys)
    it_is_stopped_and_begun_again_with_a_damaged_store(running)
    it_says_what_is_missing(running, capsys)


def it_is_well(running: Running, capsys: pytest.CaptureFixture[str]) -> None:
    ports = running.bridge_port, running.estimator_port
    assert [get(port, "/healthz") for port in ports] == [(200, "ok\n")] * 2
    ready = [(200, "ok\n")] * 2
    wait("readiness", lambda: [get(port, "/readyz") for port in ports] == ready, running.watcher, running.ward)
    assert f'truerate_bridge_device_connected{{device="{NAME}"}} 1.0' in get(running.bridge_port, "/metrics")[1]
    tracking = f'truerate_state{{device="{NAME}",state="tracking"}} 1.0'
    wait(
        "the metrics of this second",
        lambda: tracking in get(running.estimator_port, "/metrics")[1],
        running.watcher,
        running.ward,
    )
    assert "truerate_law_violations_all_total 0.0" in get(running.estimator_port, "/metrics")[1]
    code, seen = running.until_said(capsys, "is well", lambda code, _: code == 0)  # a busy machine may be in trouble
    assert (code, seen["tracking"], seen["devices"], seen["well"]) == (0, 1, 1, True)
    assert (seen["bridges"], seen["estimators"]) == (["bridge-1"], ["estimator-1"])
    capsys.readouterr()
    status = ["status", "--config", str(running.ward.config)]
    wait("well", lambda: main(status) == 0, running.watcher, running.ward)
    assert "1 of 1 tracking" in capsys.readouterr().out
    assert main(["history", NAME, "--config", str(running.ward.config)]) == 0, "while the estimator writes"
    assert "accepted (closure)" in capsys.readouterr().out.replace("\n", " ")


def it_is_stopped_and_begun_again_with_a_damaged_store(running: Running) -> None:
    calibration = running.watcher.statuses[NAME].calibration
    subscriber = Subscriber(running.ward.endpoint, WARD, keep=True)
    with ZenohBus((running.ward.endpoint,)) as bus:
        alive: dict[str, bool] = {}
        bus.watch_alive(keys.pattern(WARD, "alive/estimator"), alive.__setitem__)
        key = keys.build(WARD, "alive/estimator", estimator="estimator-1")
        wait("the token", lambda: alive.get(key, False), running.watcher, running.ward)
        running.ward.stop("bridge")
        process = running.ward._processes["estimator"]
        running.ward.stop("estimator", signal.SIGTERM)
        assert process.returncode == 0
        wait("the goodbye", lambda: not alive[key], running.watcher, running.ward)
    log = running.ward.log("estimator")
    assert "estimator-1 stopped" in log
    assert "Traceback" not in log
    ((_, boot), raw), *_ = running.watcher.raw.items()

    def all_there() -> bool:
        [batches] = subscriber.batches.values()
        return int(numbers(batches)[-1]) == raw[-1].sequence + len(raw[-1]) - 1

    wait("every sample the bridge had published", all_there, running.watcher, running.ward)
    subscriber.close()
    store = Store(running.store)
    remembered = store.recall(NAME, boot, time.time_ns())
    store.close()
    assert remembered is not None
    assert remembered.bias is not None
    # Device time runs ten times faster here: less than a checkpoint's period before the last sample.
    assert raw[-1].device_time[-1] - remembered.bias.time < 3.0
    assert not running.store.with_name("truerate.sqlite3-wal").exists(), "everything is in the one file"
    back_up(running.store, running.store.parent / "backups" / "truerate-99999.sqlite3")
    # And begun again with a store whose header was damaged meanwhile.
    data = bytearray(running.store.read_bytes())
    data[20:24] = b"\xff" * 4
    running.store.write_bytes(data)
    running.ward.start("bridge", "estimator")
    restored = f"calibration {calibration} of this boot was restored"
    wait("the restart", lambda: restored in running.ward.log("estimator"), running.watcher, running.ward)
    ready = (200, "ok\n")
    wait("readiness", lambda: get(running.estimator_port, "/readyz") == ready, running.watcher, running.ward)
    log = running.ward.log("estimator")
    assert "is damaged" in log
    assert "truerate-99999.sqlite3" in log
    assert list(running.store.parent.glob("truerate.sqlite3.aside-*"))
    damage = 'truerate_ward_events_total{event="damage in the store"}'
    wait("the metric", lambda: damage in get(running.estimator_port, "/metrics")[1], running.watcher, running.ward)


def it_says_what_is_missing(running: Running, capsys: pytest.CaptureFixture[str]) -> None:
    running.ward.ports[NAME].unplug()
    wait("the loss", lambda: running.watcher.statuses[NAME].state is State.LOST, running.watcher, running.ward)
    # What the bridge says of it, for a person.
    code, seen = running.until_said(
        capsys, "is missing", lambda _, seen: "is missing. Plug the device in" in str(seen["needs"])
    )
    assert (code, seen["tracking"]) == (1, 0)
    running.ward.stop("bridge")
    code, _ = running.until_said(capsys, "no bridge", lambda _, seen: "no_bridge" in str(seen["troubles"]))
    assert code == 1
