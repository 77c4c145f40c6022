"""What the estimator says of itself: alive, ready, metrics; of a real service over the bus in memory."""

import math
import time
from pathlib import Path

import pytest

from bridge.runtime.health_server import HealthServer
from estimator.cli.main import main
from estimator.device.lifecycle import Event
from estimator.service.health import STUCK_S, Note, ServiceHealth
from estimator.service.store import Store
from tests.bridge.asking import get
from tests.estimator.database.faults import full_disk
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info
from tests.sentences import free


def watched(ward: Ward, *, expects: bool = True) -> ServiceHealth:
    """The vitals of a ward's service, which says so from now on."""
    vitals = ServiceHealth(expects=expects)
    ward.service._stock._vitals = vitals
    return vitals


def a_second(ward: Ward) -> None:
    """Pass, in which every device is looked after."""
    ward.service._every_second(time.monotonic())
    ward.service.work()
    ward.service._every_second(time.monotonic())


def test_metrics_of_a_device_that_is_calibrated(ward: Ward, once: Stream) -> None:
    vitals = watched(ward)
    ward.send(once.batches()[:-1], info(1))
    a_second(ward)  # however long that took
    ward.service.work()
    ward.send(once.batches()[-4:])  # three of them repeated
    a_second(ward)
    with HealthServer(("127.0.0.1", 0), vitals.asked) as health:
        code, said = get(health.port, "/metrics")
        assert get(health.port, "/readyz") == (200, "ok\n")
    values = dict(line.rsplit(" ", 1) for line in said.splitlines() if line.startswith("truerate_"))
    repeated = sum(map(len, once.batches()[-4:-1]))
    assert code == 200
    assert values[f'truerate_samples_in_total{{device="{NAME}"}}'] == str(float(len(once) + repeated))
    assert values[f'truerate_samples_out_total{{device="{NAME}"}}'] == str(float(len(once)))
    assert values[f'truerate_samples_dropped_total{{device="{NAME}",reason="duplicate"}}'] == str(float(repeated))
    assert float(values[f'truerate_rate_hz{{device="{NAME}"}}']) == pytest.approx(104, abs=0.1)
    assert values[f'truerate_state{{device="{NAME}",state="tracking"}}'] == "1.0"
    assert values[f'truerate_quality{{device="{NAME}",quality="good"}}'] == "1.0"
    assert values['truerate_devices{state="tracking"}'] == "1.0"
    assert values['truerate_devices{state="lost"}'] == "0.0"
    assert values["truerate_law_violations_all_total"] == "0.0"
    assert float(values[f'truerate_latency_seconds{{device="{NAME}"}}']) > 0
    assert float(values[f'truerate_evidence_age_seconds{{device="{NAME}"}}']) >= 0
    assert 0 < float(values[f'truerate_bias_std_rad_s{{device="{NAME}"}}']) < math.radians(0.2)
    a_second(ward)
    assert not any(f.name == "latency_seconds" and f.values for f in vitals.families()), (
        "nothing was published meanwhile"
    )


def test_what_is_not_ready_and_why(ward: Ward, once: Stream) -> None:
    vitals = watched(ward)
    assert vitals.unready() == ["no router yet"]
    assert [(f.name, f.values) for f in vitals.families()] == [("bus_connected", {(): 0.0})]
    assert vitals.sick() == []
    a_second(ward)
    assert vitals.unready() == ["no device is heard"]
    assert ready(ward, expects=False) == []
    vitals = watched(ward)
    ward.send(once.batches()[:25], info(1))
    a_second(ward)
    assert vitals.unready() == []
    ward.broker.stop()
    a_second(ward)
    assert vitals.unready() == ["the router is gone"]
    ward.broker.start()
    session = ward.service._devices[NAME].session
    session.silence(free("its samples are refused as old"), Event.OUTDATED)
    a_second(ward)
    assert vitals.unready() == ["no device sends usable samples"]
    session.life.on(Event.HEARD)
    with full_disk():
        ward.service._record.boot(info(7))
        a_second(ward)
    (why,) = vitals.unready()
    assert "store" in why


def ready(ward: Ward, *, expects: bool) -> list[str]:
    vitals = watched(ward, expects=expects)
    a_second(ward)
    return vitals.unready()


def test_a_loop_that_is_stuck_is_sick() -> None:
    now = [100.0]
    vitals = ServiceHealth(clock=lambda: now[0])
    vitals.note(Note(100.0, connected=True, store=""))
    assert vitals.sick() == []
    now[0] += STUCK_S + 1
    assert vitals.sick() == ["the service's loop has been stuck for 6 s"]
    assert vitals.unready() == vitals.sick()


@pytest.mark.parametrize(
    ("bridge", "estimator", "words"),
    [
        ("127.0.0.1:9464", "127.0.0.1:9464", "a port of its own"),
        ("", "9464", "such as '127.0.0.1:9464'"),
        ("localhost:http", "", "[bridge]"),
    ],
)
def test_a_wrong_address_is_refused_by_config_check(
    bridge: str, estimator: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "w.toml"
    path.write_text(
        f'ward = "w"\n[bridge]\nid = "b"\nhealth = "{bridge}"\n[estimator]\nid = "e"\nhealth = "{estimator}"\n',
        encoding="utf-8",
    )
    assert main(["config", "check", str(path)]) == 2
    assert words in capsys.readouterr().err


def test_a_store_that_is_removed_is_there_again_within_seconds_and_that_is_counted(ward: Ward, once: Stream) -> None:
    vitals = watched(ward)
    ward.send(once.batches(), info(1))
    kept = [c.id for c in ward.store.calibrations(NAME)]
    ward.path.unlink()
    a_second(ward)
    a_second(ward)
    assert vitals._note is not None
    assert vitals._note.counts["damage in the store"] == 1
    reader = Store(ward.path)
    assert [c.id for c in reader.calibrations(NAME)] == kept
    reader.close()
