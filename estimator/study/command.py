"""Execution of the studies for the commands `truerate study NAME` and `truerate study all`."""

from pathlib import Path
from typing import Any

from msgspec import structs
from rich.console import Console

from bridge.toml.loader import ConfigError
from estimator.study import analysis, errors, magnitude, orientation, real, report, sensors, testset, typical
from estimator.study.real import RealScenario
from estimator.study.runner import Runner
from estimator.study.study import Scenario, Study

STUDIES: dict[str, Study[Any, Any]] = {
    module.STUDY.name: module.STUDY
    for module in (typical, errors, testset, sensors, magnitude, orientation, analysis, real)
}


def run_one(
    console: Console,
    name: str,
    out: Path,
    *,
    config: str = "",
    runs: int | None = None,
    quick: bool = False,
    workers: int | None = None,
    recording: Path | None = None,
) -> None:
    """Run the study `name`, with its own scenario or another, and save it in the folder `out`/`name`.

    config: name or file of another scenario; empty for the study's own.
    runs: number of runs instead of the scenario's. quick: True for few runs.
    workers: number of processes; None for one per processor.
    recording: path of the recorded session for the study `real`.
    Raises ConfigError for an unusable scenario.
    """
    scenario = _scenario(name, config, runs, quick=quick)
    if isinstance(scenario, RealScenario):
        scenario = structs.replace(scenario, recording=str(recording or scenario.recording))
        if not scenario.recording:
            raise ConfigError("the study `real` needs imucal's session: give the file with --recording FILE")
    runner = Runner(console, out, workers)
    runner.run(STUDIES[name], scenario)
    runner.forget_parts()


def run_all(
    console: Console,
    out: Path,
    *,
    quick: bool = False,
    workers: int | None = None,
    recording: Path | None = None,
    runs: int | None = None,
) -> None:
    """Run all studies and write report.html in the folder `out`; the study `real` runs only with a recording.

    recording: path of the recorded session for the study `real`.
    runs: number of runs of each study instead of the scenario's. quick: True for few runs.
    workers: number of processes; None for one per processor.
    Raises ConfigError for an unusable scenario.
    """
    runner = Runner(console, out, workers)
    done = []
    for name, study in STUDIES.items():
        scenario = _scenario(name, "", runs, quick=quick)
        if isinstance(scenario, RealScenario):
            if recording is None:
                continue
            scenario = structs.replace(scenario, recording=str(recording))
        done.append(runner.run(study, scenario))
    path = out / "report.html"
    report.write(path, done, quick=quick)
    runner.forget_parts()
    console.print(report.summary(report.rows(done)), highlight=False)
    if quick:
        console.print("Quick run: with so few sessions the verdicts are uncertain", highlight=False)
    if recording is None:
        console.print("`real` was left out: give imucal's session with --recording FILE", highlight=False)
    console.print(f"Report: {path}", highlight=False)


def _scenario(name: str, config: str, runs: int | None, *, quick: bool) -> Scenario:
    scenario: Scenario = STUDIES[name].read(config)
    if runs is not None:
        return structs.replace(scenario, runs=runs)
    return structs.replace(scenario, runs=scenario.quick_runs) if quick else scenario
