"""A certificate that ends within days is said of everywhere, before nobody is let in; and why nobody is, afterwards."""

import logging
from pathlib import Path

import pytest

from bridge.bus.router_watch import RouterWatch
from bridge.bus.routers import Routers
from bridge.diagnose.finding import Level
from bridge.diagnose.router import certificate
from bridge.ingest.health import BridgeHealth as BridgeVitals
from bridge.pki.certificate_checks import Identity
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from bridge.runtime.health_server import HealthServer
from estimator.cli.main import main
from estimator.service.health import Note, ServiceHealth
from tests.bridge.asking import get
from tests.bridge.pki.office import DAY

B1 = Member.parse("bridge:b1")
SOON = "expires on "


class Holder:
    """Of a certificate of three months that lasts so many days more."""

    def __init__(self, path: Path, days: float) -> None:
        self.folder = Folder(path / "pki")
        begun = utc_now() - (90 - days) * DAY
        self.folder.make("w", begun)
        self.files: Identity = self.folder.issue(B1, begun, days=90)
        self.routers = Routers(("tls/127.0.0.1:1",), self.files)
        self.ward = path / "ward.toml"
        self.ward.write_text(
            f'ward = "w"\n[bus]\nconnect = ["tls/127.0.0.1:1"]\nca = "{self.files.ca}"\n'
            f'certificate = "{self.files.certificate}"\nkey = "{self.files.key}"\n[bridge]\nid = "b1"\n',
            "utf-8",
        )


@pytest.mark.parametrize(("days", "soon"), [(3, True), (30, False)])
def test_an_end_within_days_is_said_by_who_looks_through_files(
    days: float, soon: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    holder = Holder(tmp_path, days)
    assert main(["config", "check", str(holder.ward)]) == 0
    assert (SOON in capsys.readouterr().out) == soon
    (finding,) = certificate(holder.routers)
    assert finding.level is (Level.WARNING if soon else Level.OK)


@pytest.mark.parametrize(("days", "why"), [(0, "expired on"), (30, "may have been revoked")])
def test_who_is_not_let_in_any_more_says_why_that_may_be(
    days: float, why: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    watched = RouterWatch(logging.getLogger("here"), Holder(tmp_path, days).routers)
    for now in range(60):
        watched.look(now, connected=not 10 <= now < 50)
    assert [why in words for words in caplog.messages] == [False, True]


def test_metrics_say_when_it_ends_and_readyz_why_there_is_no_router(tmp_path: Path) -> None:
    holder = Holder(tmp_path, 0)
    estimator = ServiceHealth(clock=lambda: 1.0, routers=holder.routers)
    estimator.note(Note(1.0, connected=False, store=""))
    bridge = BridgeVitals(list, lambda: float("inf"), lambda: False, holder.routers)
    for vitals in (estimator, bridge):
        with HealthServer(("127.0.0.1", 0), vitals.asked) as health:
            _, said = get(health.port, "/metrics")
            values = dict(line.rsplit(" ", 1) for line in said.splitlines() if line.startswith("truerate_"))
            ends = float(values["truerate_certificate_ends_timestamp_seconds"])
            assert abs(ends - utc_now().timestamp()) < 60
            assert "expired on" in get(health.port, "/readyz")[1]
