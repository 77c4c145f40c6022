"""The service in trouble: failing sessions, several senders, phantoms, full disks, other estimators."""

import logging
import socket
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Quality, SampleBatch, State
from estimator.config import schema
from estimator.config.schema import Estimator
from estimator.database import StoreError, owned
from estimator.service import device_roster, serve
from estimator.service.overload import OVERLOADED
from tests.estimator.database.faults import full_disk
from tests.estimator.memory_ward import SILENCE_S, WARD, Ward
from tests.estimator.stream import NAME, Stream, calibration, info


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1, after=[Still(8.0)])


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The service's steady clock, to be set by hand; how busy this machine is makes no difference."""
    now = [1000.0]
    monkeypatch.setattr("estimator.service.overload.BUSY", inf)
    monkeypatch.setattr("estimator.service.run_loop.time.monotonic", lambda: now[0])
    return now


def put(ward: Ward, batch: SampleBatch, bridge: str = "bridge") -> None:
    ward.put(codec.encode_samples(batch), bridge=bridge, device=batch.device)


@pytest.mark.parametrize("boot", [1, 2])
def test_a_second_bridge_silences_nobody(
    ward: Ward, once: Stream, boot: int, clock: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    batches = once.batches()
    for n, batch in enumerate(batches):
        ward.send([batch], info(1) if n == 0 else None)
        clock[0] += 0.1
        if n % 3 == 0:
            put(ward, replace(batch, boot=boot, sequence=batch.sequence + 7, gyro=-batch.gyro), "second")
    assert list(ward.subscriber)[-1].quality is Quality.GOOD
    status = ward.latest()
    assert status.samples_out == len(once)
    events = {name: n for name, n in status.events.items() if name != OVERLOADED}  # this clock never passes in a wait
    assert events == {"also from second": sum(len(b) for b in batches[::3])}
    assert (status.bridge, status.refused_bridges) == ("bridge", ("second",))
    said = english(Code.TWO_BRIDGES(devices=NAME, owner="bridge", refused="second"))
    assert caplog.text.count(said) == 1
    clock[0] += SILENCE_S + 3.0  # the second is silent
    ward.service.step(0.0)
    assert ward.latest().refused_bridges == ()


def test_phantoms_are_forgotten_for_a_real_device(
    ward: Ward,
    once: Stream,
    monkeypatch: pytest.MonkeyPatch,
    clock: list[float],
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(device_roster, "MAX_DEVICES", 3)
    ward.send(once.batches(), info(1))
    (batch,) = once.part(0, 10).batches([])
    for name in ("a", "b", "c", "d"):
        put(ward, replace(batch, device=name))
        ward._bridge.publisher(keys.build(WARD, "info", bridge="bridge", device=name)).put(
            codec.encode_info(replace(info(1), device=name))
        )
    assert ward.service.counts.as_dict()[device_roster.TOO_MANY] == 20
    assert caplog.text.count("devices are allowed") == 1
    clock[0] += SILENCE_S + 9.0
    put(ward, replace(batch, device="real"))
    assert set(ward.service._devices) == {NAME, "real"}, "the calibrated one is lost too, but not forgotten"
    assert ward.service.counts.as_dict()["devices forgotten"] == 2
    assert len(ward.service._devices._infos) <= 3
    assert ward.service._devices.info("bridge", NAME) is not None


def test_refusals_can_be_seen(ward: Ward, once: Stream, clock: list[float], caplog: pytest.LogCaptureFixture) -> None:
    batches = once.batches()
    ward.send(batches[:50], info(1))
    caplog.set_level(logging.INFO)
    caplog.clear()
    for payload, device in ((b"\x00\xff", NAME), (b"\x00\xff", NAME), (b"\x00\xff", "stranger")):
        ward.put(payload, bridge="bridge", device=device)
    assert ward.latest().events == {"refused malformed": 2}
    assert caplog.text.count("so far: sample messages refused, malformed 3") == 1
    ward.put(b"\x00\xff", bridge="bridge", device="stranger")
    ward.latest()
    assert "malformed 4" not in caplog.text, "not so soon"
    clock[0] += 11.0
    ward.latest()
    ward.latest()
    assert caplog.text.count("malformed 4") == 1


def test_a_calibration_made_while_the_disk_is_full_is_saved_later(ward: Ward, once: Stream) -> None:
    with full_disk():
        ward.send(once.batches(), info(1))
        assert ward.store.calibrations(NAME) == []
        assert ward.latest().quality is Quality.GOOD
    ward.settle()
    (saved,) = ward.store.calibrations(NAME)
    assert saved.id == ward.latest().calibration
    assert ward.store.recall(NAME, 1, 0) is not None


def same_id(monkeypatch: pytest.MonkeyPatch) -> None:
    class Same:
        hex = "r1"

    monkeypatch.setattr("estimator.client.client.uuid.uuid4", Same)


def test_a_command_sent_again_to_a_restarted_estimator_changes_nothing(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    ward.send(once.batches(), info(1))
    with monkeypatch.context() as patch:
        same_id(patch)
        first = ward.command(lambda: ward.client.recalibrate(NAME, "nurse"))
        assert first.accepted
    ward.command(lambda: ward.client.cancel(NAME, "nurse"))
    ward.kill()
    ward.start()
    ward.send(once.batches()[-5:])
    same_id(monkeypatch)
    again = ward.command(lambda: ward.client.recalibrate(NAME, "nurse"))
    assert again == first
    assert ward.latest().state is State.TRACKING
    assert [row["verb"] for row in ward.store.database.rows("audit")] == ["recalibrate", "cancel"]


def test_a_recalibration_goes_on_when_the_estimator_is_restarted(ward: Ward, once: Stream) -> None:
    """The old calibration stays in force until the turns are done, or it is cancelled."""
    ward.send(once.batches(), info(1))
    (old,) = ward.store.calibrations(NAME)
    assert ward.command(lambda: ward.client.recalibrate(NAME, "nurse", "it was dropped")).accepted
    for _ in range(2):
        ward.kill()
        ward.start()
        ward.send(once.batches()[-5:])
        status = ward.latest()
        assert status.state in (State.AWAITING_STILL, State.BIAS_ONLY)
        assert (status.quality, status.calibration) == (Quality.GOOD, old.id)
    assert ward.service._devices[NAME].session.learnt.asked == ("nurse", "it was dropped")
    assert ward.command(lambda: ward.client.cancel(NAME, "nurse")).accepted
    ward.kill()
    ward.start()
    ward.send(once.batches()[-5:])
    assert (ward.latest().state, ward.latest().calibration) == (State.TRACKING, old.id)


def test_an_estimator_does_not_start_where_another_program_has_its_port_or_its_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, opened = str(tmp_path / "s.sqlite3"), list[object]()
    monkeypatch.setattr(serve, "Database", lambda *words, **_: opened.append(words))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        settings = Estimator(id="e1", store=path, health=f"127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(OSError, match="in use by another program; choose another `health`"):
            serve.run(schema.Ward(ward=WARD, estimator=settings))
    with owned(path), pytest.raises(StoreError, match=r"another estimator uses it"):
        serve.run(schema.Ward(ward=WARD, estimator=Estimator(id="e1", store=path)))
    assert not opened
