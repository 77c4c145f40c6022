"""A ward file changed while a ward runs, with real processes."""

from pathlib import Path

import pytest

from estimator.cli.main import main
from estimator.demo.ward import WARD, Ward
from tests.bench.reload import ADDED, RENAMED, measure
from tests.bridge.pki.guarded_ward import GuardedWard
from tests.ward.parts import add_simulated

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(240)]


def test_devices_come_and_leave_and_the_others_notice_nothing(tmp_path: Path) -> None:
    outcome = measure(tmp_path, devices=2, speed=10.0)
    assert [code for code, _ in outcome.said] == [0, 0, 0]
    said = "\n".join(words for _, words in outcome.said)
    for change in (f"+{ADDED}.", f"-going +{RENAMED}.", f"-{ADDED}."):
        assert f"bridge bridge-1: Now in force from the ward's file: bridge.devices {change}" in said
    assert outcome.samples > 2000
    assert outcome.undisturbed, outcome


def test_a_ward_with_certificates_takes_a_change_and_refuses_a_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded = GuardedWard(tmp_path / "pki", ("bridge:bridge-1", "estimator:estimator-1", "commander:desk"))
    guarded.write((WARD,))
    programs = ("bridge bridge-1", "estimator estimator-1", "dashboard desk")
    with guarded.running(), Ward(tmp_path, ()) as ward:

        def reloaded(text: str, code: int | None) -> str:
            ward.config.write_text(text, "utf-8")
            found = main(["reload", "--config", str(ward.config)])
            assert code in (None, found)
            return "".join(capsys.readouterr())

        add_simulated(ward, ["stays"], 1.0)
        by_tls = f'connect = ["{guarded.endpoint}"]\npki = "{guarded.folder.path}"'
        text = ward.config.read_text("utf-8").replace(f'connect = ["{ward.endpoint}"]', by_tls)
        ward.config.write_text(text, "utf-8")
        ward.start("bridge", "estimator", "dashboard")
        out = ""
        while not all(f"{name}: All of" in out for name in programs):
            ward.check()
            out = reloaded(text, None)
        more = text.replace("[estimator]", '[[bridge.devices]]\nid = "more"\ndriver = "simulated"\n\n[estimator]')
        more += '\n[estimator.models]\nstays = "lsm9ds1"\n[alerts]\nquiet_hours = "22:00-06:00"\n'
        out = reloaded(more, 0)
        assert "bridge bridge-1: Now in force from the ward's file: bridge.devices +more." in out
        said = "Now in force from the ward's file: estimator.models +stays; alerts.quiet_hours."
        assert f"estimator estimator-1: {said}" in out
        assert f"dashboard desk: {said}" in out
        out = reloaded(more.replace("truerate.sqlite3", "other.sqlite3"), 1)
        assert out.count("estimator.store") == 2, "of the estimator, and of the dashboard that reads the store"
        assert "bridge bridge-1: All of the ward's file is in force." in out
        assert "unknown driver 'simulate'; did you mean 'simulated'?" in reloaded(
            more.replace('"simulated"', '"simulate"'), 2
        )
        while "earlier one stays in force" not in ward.log("bridge"):
            ward.check()
        assert reloaded(more, 0).count("All of the ward's file is in force.") == 3
    assert not ward.complaints
