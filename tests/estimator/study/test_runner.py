"""A study computed by any number of processes, in one go or in two, has the same results."""

import json
from pathlib import Path

import pytest
from msgspec import structs
from rich.console import Console

from estimator.study.errors import STUDY, ErrorsScenario
from estimator.study.runner import Runner

QUIET = Console(quiet=True)


@pytest.fixture
def scenario() -> ErrorsScenario:
    return structs.replace(STUDY.read(), runs=6, sets=3, noise_dps=(0.1,), paper_band=(0.01,), rate_hz=25)


def computed(out: Path, scenario: ErrorsScenario, workers: int = 1) -> bytes:
    Runner(QUIET, out, workers).run(STUDY, scenario)
    return (out / "errors" / "results.json").read_bytes()


def parts(out: Path) -> list[Path]:
    return sorted((out / ".parts").glob("*/*.npz"))


def test_workers_change_nothing(tmp_path: Path, scenario: ErrorsScenario) -> None:
    one, two = (computed(tmp_path / str(workers), scenario, workers) for workers in (1, 2))
    assert one == two
    assert json.loads(one)["scenario"]["runs"] == 6


def test_a_study_goes_on_from_the_parts_it_left(tmp_path: Path, scenario: ErrorsScenario) -> None:
    whole = computed(tmp_path, scenario)
    kept = parts(tmp_path)
    assert len(kept) == 3
    kept[0].unlink()
    (tmp_path / "errors" / "results.json").unlink()
    before = {path: path.stat().st_mtime_ns for path in kept[1:]}
    assert computed(tmp_path, scenario) == whole
    assert parts(tmp_path) == kept
    assert {path: path.stat().st_mtime_ns for path in kept[1:]} == before
