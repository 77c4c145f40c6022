"""Alerts of a running estimator: raised, acknowledged by name, kept over a restart, cleared; and its own troubles."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from bridge.bus.certificate_metric import ENDS
from bridge.bus.routers import Routers
from bridge.diagnose import machine
from bridge.reasons.codes import Code
from bridge.wire.messages import Alert, Placement, State
from estimator.alerts.board import Change
from estimator.config.alerts import Alerts
from estimator.config.schema import Estimator
from estimator.device.attention import Kind
from estimator.service.own_alerts import LOOK_S, OwnAlerts
from estimator.service.run_loop import Service
from estimator.service.store import Store
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info
from tests.sentences import codes

ROOT = Path(__file__).parents[3]
AT_ONCE = Alerts(hold_s=dict.fromkeys(Kind, 0.0), clear_s=1.0)


class Calls:
    """Who was called about what."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str, bool]] = []

    def __call__(self, subject: str, _: Placement | None, change: Change) -> None:
        if change.alert.kind == Kind.BATTERY_LOW:
            self.told.append((subject, change.alert.kind, change.cleared))


@pytest.fixture
def alert_ward(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Ward, Calls]:
    calls = Calls()
    made = partial(Service, alerts=AT_ONCE, send=calls)
    monkeypatch.setattr("tests.estimator.memory_ward.Service", made)
    return Ward(tmp_path), calls


def standing(ward: Ward) -> list[Alert]:
    return [one for one in ward.latest().alerts if one.kind == Kind.BATTERY_LOW]


def test_a_low_battery_is_said_once_acknowledged_and_cleared_over_a_restart(
    alert_ward: tuple[Ward, Calls], once: Stream
) -> None:
    ward, calls = alert_ward
    low = replace(info(1), battery_percent=9.0)
    ward.send(once.part(0, 260).batches(), low)
    (alert,) = standing(ward)
    assert (alert.who, alert.acknowledged_ns) == ("", 0)
    ward.kill()
    ward.start()
    ward.send(once.part(260, 520).batches(), low)
    assert standing(ward) == [alert]
    reply = ward.command(lambda: ward.client.acknowledge(NAME, "anna", "battery_low"))
    assert codes(reply.message) == [Code.ACKNOWLEDGED]
    (seen,) = standing(ward)
    assert (seen.who, seen.acknowledged_ns) == ("anna", ward.now_ns)
    again = ward.command(lambda: ward.client.acknowledge(NAME, "bo", "battery_low"))
    assert (again.accepted, codes(again.message)) == (False, [Code.NOTHING_TO_ACKNOWLEDGE])
    ward.send(once.part(520, 560).batches(), replace(low, charging=True))
    standing(ward)
    time.sleep(1.1)
    assert standing(ward) == []
    assert calls.told == [(NAME, "battery_low", False), (NAME, "battery_low", True)]
    stored = [(one.who, end is not None) for one, end in ward.store.alerts(NAME) if one.kind == Kind.BATTERY_LOW]
    assert stored == [("anna", True)]
    ward.kill()


@pytest.mark.parametrize("ended", ["stop", "kill"])
def test_a_device_that_is_gone_when_the_estimator_starts_is_lost(
    tmp_path: Path, once: Stream, monkeypatch: pytest.MonkeyPatch, ended: str
) -> None:
    monkeypatch.setattr("tests.estimator.memory_ward.Service", partial(Service, alerts=Alerts(hold_s={"lost": 0.0})))
    monkeypatch.setattr("tests.estimator.memory_ward.SETTINGS", Estimator(id="e1", silence_s=50.0))
    monkeypatch.setattr("estimator.service.run_loop.MISSING_S", 0.0)
    ward = Ward(tmp_path)
    most = len(once) - 60
    ward.send(once.part(0, most).batches(), info(1))
    before = ward.latest()
    ward.command(lambda: ward.client.note(NAME, "anna", "sat up"))  # which stores the bias
    getattr(ward, ended)()
    ward.now_ns += 60 * 10**9
    ward.start()
    lost = ward.latest()
    assert lost.state is State.LOST
    assert [one.code for one in lost.reason] == [Code.NO_SAMPLES]
    assert float(lost.reason[0].params["duration"].removesuffix(" s")) > 55.0
    assert [one.kind for one in lost.alerts] == [Kind.LOST]
    assert ward.command(lambda: ward.client.acknowledge(NAME, "anna", "lost")).accepted
    ward.kill()
    ward.now_ns += 60 * 10**9
    ward.start()
    (again,) = ward.latest().alerts
    assert (again.raised_ns, again.who) == (lost.alerts[0].raised_ns, "anna"), "another restart changes nothing"
    ward.send(once.part(most, len(once)).batches(), info(1))
    after = ward.latest()
    assert (after.state, after.calibration) == (before.state, before.calibration)
    assert after.calibration
    assert ward.service.counts.as_dict().get("conservation law broken", 0) == 0
    ward.kill()


def test_an_estimators_own_troubles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, told = Store(tmp_path / "a.sqlite3"), list[Change]()

    class Soon(Routers):
        def soon(self) -> list[str]:
            return ["expires"]

    uncopied = list[str]()
    own = OwnAlerts(
        "e1", AT_ONCE, store.database, Soon(()), told.append, (), 0.0, lambda work: work(), lambda: bool(uncopied)
    )
    monkeypatch.setattr(machine, "clock_status", lambda: 0x40)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**6}))
    monkeypatch.setattr(type(store.database._backups), "make", _no_room)
    store.database.back_up_if_due()
    own.look(1.0, 1)
    assert {one.alert.kind for one in told} == {Kind.DISK, Kind.CLOCK, Kind.CERTIFICATE, Kind.BACKUP}
    assert [one.alert.who for one in own.acknowledge("disk", "anna", 2)] == ["anna"]
    monkeypatch.undo()
    monkeypatch.setattr(machine, "clock_status", lambda: 0)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**12}))
    store.database.back_up_if_due()
    own._routers = Routers(())
    own.look(LOOK_S + 1.0, 2)
    own.look(LOOK_S + 2.5, 3)
    assert not own.board.standing
    uncopied.append("the bucket does not answer")
    own.look(LOOK_S + 3.0, 4)
    assert [one.kind for one in own.board.standing] == [Kind.BACKUP]
    store.close()


def _no_room(_: object) -> Path:
    from estimator.database import Unavailable

    raise Unavailable("no room")


def test_prometheus_rules_ask_for_metrics_that_there_are(alert_ward: tuple[Ward, Calls], once: Stream) -> None:
    import re

    yaml = pytest.importorskip("yaml")
    ward, _ = alert_ward
    vitals = ward.service._stock._vitals
    ward.send(once.part(0, 260).batches(), replace(info(1), battery_percent=9.0))
    ward.latest()
    ward.latest()
    families = {one.name: one for one in vitals.families()} | {ENDS.name: ENDS}
    assert families["alert"].values[NAME, "battery_low"] == 1
    (group,) = yaml.safe_load((ROOT / "configs" / "alerts.rules.yml").read_text())["groups"]
    assert len({rule["alert"] for rule in group["rules"]}) == len(group["rules"])
    for rule in group["rules"]:
        assert (
            {"alert", "expr", "labels", "annotations"}
            <= rule.keys()
            <= {"alert", "expr", "for", "labels", "annotations"}
        )
        assert {"summary", "description"} == rule["annotations"].keys()
        for name, labels in re.findall(r"truerate_(\w+)(?:\{(\w+))?", re.sub(r'"[^"]*"', "", rule["expr"])):
            assert name in families
            assert not labels or labels in families[name].labels
    ward.kill()
