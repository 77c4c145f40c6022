"""Study runner: spreads jobs over processes, and saves results.json, tables and figures.

The arrays of each finished job are saved in OUT/.parts, and an interrupted study continues from these. Their folder is
named after the work and a digest of its inputs, so changed inputs never use old arrays.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track

from estimator.study.study import Arrays, Job, Parts, Scenario, Study
from estimator.study.worker_processes import started

AnyStudy = Study[Any, Any]


@dataclass(frozen=True, slots=True)
class Done:
    """Finished study with its results, and the paths of its figures without suffix."""

    study: AnyStudy
    results: Any
    figures: tuple[Path, ...]


class Runner:
    """Runner of studies that saves their results in a folder `out`.

    workers: number of processes; None for one per processor; 1 for the present process.
    """

    def __init__(self, console: Console, out: Path, workers: int | None) -> None:
        self._console, self._out, self._workers = console, out, workers
        self._parts = out / ".parts"

    def run(self, study: AnyStudy, scenario: Scenario) -> Done:
        """Run a study: compute the jobs not yet saved, save results.json and figures in OUT/NAME, and print the tables."""
        from estimator.study.figures.drawing import draw  # noqa: PLC0415 - matplotlib takes a second to load, in each worker

        results = study.results(scenario, self._computed(study, study.inputs(scenario)))
        folder = self._out / study.name
        folder.mkdir(parents=True, exist_ok=True)
        told = {"study": study.name, "truerate": version("truerate"), "scenario": scenario, "results": results}
        _replace(folder / "results.json", msgspec.json.format(msgspec.json.encode(told), indent=1) + b"\n")
        names = draw(study.name, results, folder)
        for table in study.tables(results):
            self._console.print(table, highlight=False)
        self._console.print(f"In {folder}: results.json, {', '.join(names)} (.svg, .pdf, .png)", highlight=False)
        return Done(study, results, tuple(folder / name for name in names))

    def forget_parts(self) -> None:
        """Delete the saved arrays of finished jobs of all studies, from which an interrupted run would continue."""
        shutil.rmtree(self._parts, ignore_errors=True)

    def _computed(self, study: AnyStudy, inputs: Any) -> Parts:
        jobs = study.jobs(inputs)
        if study.work is None or not jobs:
            return {}
        folder = self._parts / _key(study.work, inputs)
        folder.mkdir(parents=True, exist_ok=True)
        parts = {job: part for job in jobs if (part := _kept(folder, job)) is not None}
        missing = [(study.work, inputs, job) for job in jobs if job not in parts]
        with _spread(self._workers, missing) as done:
            try:
                for job, part in track(
                    done,
                    study.name,
                    total=len(jobs),
                    completed=len(parts),
                    console=self._console,
                    transient=True,
                    disable=not missing,
                ):
                    _keep(folder, job, part)
                    parts[job] = part
            except KeyboardInterrupt:
                self._console.print(f"{study.name}: stopped; run the same command again to continue", highlight=False)
                raise
        return {job: parts[job] for job in jobs}


@contextmanager
def _spread(workers: int | None, tasks: Sequence[Any]) -> Iterator[Iterator[tuple[Job, Arrays]]]:
    """Results of the tasks, in any order, from worker processes."""
    if workers == 1 or len(tasks) < 2:
        yield map(_do, tasks)
        return
    with started(workers) as pool:
        yield pool.imap_unordered(_do, tasks)


def _do(task: tuple[Any, Any, Job]) -> tuple[Job, Arrays]:
    work, inputs, job = task
    return job, work(inputs, job)


def _key(work: Callable[..., Arrays], inputs: Any) -> str:
    told = msgspec.json.encode([version("truerate"), inputs])
    return f"{work.__module__.rpartition('.')[-1]}-{hashlib.sha256(told).hexdigest()[:16]}"


def _file(folder: Path, job: Job) -> Path:
    return folder / f"{hashlib.sha256(repr(job).encode()).hexdigest()[:16]}.npz"


def _kept(folder: Path, job: Job) -> Arrays | None:
    try:
        with np.load(_file(folder, job), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        return None


def _keep(folder: Path, job: Job, part: Arrays) -> None:
    path = _file(folder, job)
    unfinished = path.with_suffix(".part")
    with unfinished.open("wb") as file:
        np.savez(file, **part)  # type: ignore[arg-type] # no part is called allow_pickle
    unfinished.replace(path)


def _replace(path: Path, data: bytes) -> None:
    unfinished = path.with_name(f".{path.name}.part")
    unfinished.write_bytes(data)
    unfinished.replace(path)
