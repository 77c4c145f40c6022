"""All studies with the fewest runs: each item of the paper is computed, and the report stands alone."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from estimator.study.command import run_all
from estimator.study.report import ITEMS


@pytest.mark.timeout(600)  # it draws every figure of every study
def test_every_table_figure_and_claim_of_the_paper(tmp_path: Path) -> None:
    shown = io.StringIO()
    run_all(Console(file=shown, width=80), tmp_path, runs=1, workers=1)
    text = shown.getvalue()
    assert max(map(len, text.splitlines())) <= 80
    assert "13 of 13 tables, figures and claims computed" in text
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(ITEMS) == 13
    assert "13 of 13 were computed" in page.replace("\n", " ")
    assert "not run" not in page
    for item in ITEMS:
        assert f"<td>{item.where}</td>" in page
        assert f"truerate study {item.study}<" in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert page.count("data:image/svg+xml") == 8
    assert not (tmp_path / ".parts").exists()
    assert {path.suffix for path in tmp_path.glob("*/*")} == {".json", ".svg", ".pdf", ".png"}
