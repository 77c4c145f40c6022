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
        assert f"bridge bridge-1: Taken from the ward's file: bridge.devices {change}" in said
    assert outcome.samples > 2000
    assert outcome.undisturbed, outcome


def test_a_ward_with_certificates_takes_a_change(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    guarded = GuardedWard(tmp_path / "pki", ("bridge:bridge-1", "estimator:estimator-1", "commander:desk"))
    guarded.write((WARD,))
    with guarded.running(), Ward(tmp_path, ()) as ward:
        add_simulated(ward, ["stays"], 1.0)
        by_tls = f'connect = ["{guarded.endpoint}"]\npki = "{guarded.folder.path}"'
        text = ward.config.read_text("utf-8").replace(f'connect = ["{ward.endpoint}"]', by_tls)
        ward.config.write_text(text, "utf-8")
        ward.start("bridge", "estimator", "dashboard")
        out = ""
        while not all(
            f"{name}: All of" in out for name in ("bridge bridge-1", "estimator estimator-1", "dashboard desk")
        ):
            ward.check()
            main(["reload", "--config", str(ward.config)])
            out = capsys.readouterr().out
        more = text.replace("[estimator]", '[[bridge.devices]]\nid = "more"\ndriver = "simulated"\n\n[estimator]')
        more += '\n[estimator.placements]\nstays = { wearer = "bed-3" }\n[alerts]\nquiet_hours = "22:00-06:00"\n'
        ward.config.write_text(more, "utf-8")
        assert main(["reload", "--config", str(ward.config)]) == 0
        out = capsys.readouterr().out
        assert "bridge bridge-1: Taken from the ward's file: bridge.devices +more." in out
        said = "Taken from the ward's file: estimator.placements +stays; alerts.quiet_hours."
        assert f"estimator estimator-1: {said}" in out
        assert f"dashboard desk: {said}" in out
    assert not ward.complaints


def test_a_file_with_a_fault_is_refused_and_what_runs_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Ward(tmp_path, ("chest",)) as ward:
        ward.start("router", "bridge", "estimator", "dashboard")
        ward.wait_for_router()
        text = ward.config.read_text("utf-8")
        out = ""
        while not all(f"{name}: All of" in out for name in ("bridge bridge-1", "estimator estimator-1", "dashboard")):
            ward.check()
            assert main(["reload", "--config", str(ward.config)]) in (0, 1)
            out = capsys.readouterr().out
        ward.config.write_text(text.replace("truerate.sqlite3", "other.sqlite3"), "utf-8")
        assert main(["reload", "--config", str(ward.config)]) == 1
        out = capsys.readouterr().out
        assert out.count("estimator.store") == 2, "of the estimator, and of the dashboard that reads the store"
        assert "bridge bridge-1: All of the ward's file is in force." in out
        ward.config.write_text(text.replace("native", "nativ"), "utf-8")
        assert main(["reload", "--config", str(ward.config)]) == 2
        assert "unknown driver 'nativ'; did you mean 'native'?" in capsys.readouterr().err
        while "earlier one stays in force" not in ward.log("bridge"):
            ward.check()
        ward.config.write_text(text, "utf-8")
        assert main(["reload", "--config", str(ward.config)]) == 0
        assert capsys.readouterr().out.count("All of the ward's file is in force.") == 3
    assert not ward.complaints
