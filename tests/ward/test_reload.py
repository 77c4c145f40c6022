"""A ward file changed while a ward runs, with real processes."""

import time
from pathlib import Path

import pytest

from estimator.cli.main import main
from estimator.demo.ward import WARD, Ward
from tests.bench.reload import ADDED, RENAMED, measure
from tests.bridge.pki.guarded_ward import GuardedWard
from tests.ward.parts import add_simulated, until

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(240)]


def test_devices_come_and_leave_and_the_others_notice_nothing(tmp_path: Path) -> None:
    outcome = measure(tmp_path, devices=2, speed=10.0)
    assert [code for code, _ in outcome.said] == [0, 0, 0]
    said = "\n".join(words for _, words in outcome.said)
    for change in (f"+{ADDED}.", f"-going +{RENAMED}.", f"-{ADDED}."):
        assert f"bridge bridge-1: Now in force from the ward file: bridge.devices {change}" in said
    assert outcome.samples > 2000
    assert outcome.undisturbed, outcome


def test_a_ward_with_certificates_takes_a_change_and_refuses_a_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded = GuardedWard(tmp_path / "pki", ("bridge:bridge-1", "estimator:estimator-1", "commander:desk"))
    guarded.write((WARD,))
    programs = ("bridge bridge-1", "estimator estimator-1", "dashboard desk")
    with guarded.running(), Ward(tmp_path, ()) as ward:

        def reloaded(text: str, code: int, *words: str) -> None:
            """Until `truerate reload` ends with this code and says these words: a busy program may answer late."""
            ward.config.write_text(text, "utf-8")
            deadline = time.monotonic() + 90.0
            found, said = None, ""
            while found != code or not all(one in said for one in words):
                assert time.monotonic() < deadline, (found, said)
                ward.check()
                found = main(["reload", "--config", str(ward.config)])
                said = "".join(capsys.readouterr())

        add_simulated(ward, ["stays"], 1.0)
        by_tls = f'connect = ["{guarded.endpoint}"]\npki = "{guarded.folder.path}"'
        text = ward.config.read_text("utf-8").replace(f'connect = ["{ward.endpoint}"]', by_tls)
        ward.config.write_text(text, "utf-8")
        ward.start("bridge", "estimator", "dashboard")
        in_force = [f"{name}: The whole ward file is in force." for name in programs]
        reloaded(text, 0, *in_force)
        more = text.replace("[estimator]", '[[bridge.devices]]\nid = "more"\ndriver = "simulated"\n\n[estimator]')
        more += '\n[estimator.models]\nstays = "lsm9ds1"\n[alerts]\nquiet_hours = "22:00-06:00"\n'
        taken = "Now in force from the ward file:"
        both = f"{taken} estimator.models +stays; alerts.quiet_hours."
        reloaded(
            more, 0, f"{programs[0]}: {taken} bridge.devices +more.", f"{programs[1]}: {both}", f"{programs[2]}: {both}"
        )
        # The estimator's store, which the dashboard reads too.
        waits = [
            f"{name}: These settings take effect when this program restarts: estimator.store." for name in programs
        ]
        reloaded(more.replace("truerate.sqlite3", "other.sqlite3"), 1, in_force[0], *waits[1:])
        reloaded(more.replace('"simulated"', '"simulate"'), 2, "unknown driver 'simulate'; did you mean 'simulated'?")
        until("bridge", lambda: "earlier settings stay in force" in ward.log("bridge"), ward)
        reloaded(more, 0, *in_force)
    assert not ward.complaints
