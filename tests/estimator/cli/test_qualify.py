"""`truerate qualify`: the report says what was checked, and a failure of either part is a failure."""

from pathlib import Path

import pytest
from rich.console import Console

from estimator.cli.main import main
from estimator.demo import run as demo


@pytest.mark.parametrize("operates", [True, False])
def test_the_report_has_both_parts_and_the_worse_one_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, operates: bool
) -> None:
    def short(console: Console, _picture: Path, _seed: int) -> bool:  # the demo itself takes a minute: `make demo`
        console.print("samples sent and received")
        return operates

    monkeypatch.setattr(demo, "run", short)
    out = tmp_path / "report.md"
    code = main(["qualify", "--out", str(out)])
    report, said = out.read_text(), capsys.readouterr().out
    assert f"| operation | **{'passed' if operates else 'failed'}** |" in report
    assert "samples sent and received" in report
    assert "| numpy |" in report
    assert "files are as packaged |" in report
    assert "reviewed by" in report
    assert f"Operation: {'passed' if operates else 'failed'}" in said
    assert code == (0 if operates and "**failed**" not in report else 1)


def test_a_report_that_cannot_be_written_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["qualify", "--out", str(tmp_path / "none/report.md")]) == 2
    assert "there is no such" in capsys.readouterr().err
