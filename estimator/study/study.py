"""Definition of a study: a scenario from a TOML file, and jobs that compute arrays.

Results, tables, figures and findings are made from these arrays.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from rich.console import RenderableType

from bridge.toml.loader import load
from bridge.toml.shipped import file_of
from estimator.study.names import STUDIES

S = TypeVar("S", bound="Scenario")
R = TypeVar("R", bound=Struct)
Floats = NDArray[np.float64]
#: arguments of one job, numbers and words; equal arguments mean equal work
Job = tuple[str | int | float, ...]
#: arrays computed by a job, by name
Arrays = dict[str, NDArray[Any]]
Parts = Mapping[Job, Arrays]
Verdict = Literal["agrees", "agrees in part", "differs"]

_HERE = Path(__file__).parent
FOLDERS = (_HERE / "scenarios", _HERE.parents[1] / "configs" / "study")  # in an installed package; in a checkout


class Scenario(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Scenario of any study, read from its TOML file: number of runs, number of runs for a quick look, and random seed.

    Raises ValueError when runs or quick_runs is below 1.
    """

    runs: int
    quick_runs: int
    seed: int = 1

    def __post_init__(self) -> None:
        for key in ("runs", "quick_runs"):
            if (value := getattr(self, key)) < 1:
                raise ValueError(f"{key} is {value}; allowed: 1 or more")


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of a study for one item of the paper: our result as text, and whether it agrees.

    item: key of the item in report.ITEMS.
    why: the part that disagrees, or the limit of the comparison.
    """

    item: str
    ours: str
    verdict: Verdict
    why: str = ""


@dataclass(frozen=True, slots=True)
class Study(Generic[S, R]):
    """Definition of a study: functions that compute its results and present them.

    name: of the command and of configs/study/NAME.toml, which is read as `scenario`.
    inputs(scenario): all values on which a job depends. Saved arrays are used again for equal `work` and inputs.
    jobs(inputs): list of jobs, which run in parallel. A study of one session has no jobs.
    work(inputs, job): computes the arrays of one job, in another process.
    results(scenario, parts): content of results.json, from the arrays of all jobs (parts).
    tables(results): tables for a terminal.
    findings(results): findings for the report, for the scenario that comes with truerate.
    """

    name: str
    scenario: type[S]
    results: Callable[[S, Parts], R]
    tables: Callable[[R], Sequence[RenderableType]]
    findings: Callable[[R], Sequence[Finding]]
    inputs: Callable[[S], Any] = lambda scenario: scenario
    jobs: Callable[[Any], Sequence[Job]] = lambda _: ()
    work: Callable[[Any, Job], Arrays] | None = None

    @property
    def does(self) -> str:
        """Description of the study in a few words, for the command's help."""
        return STUDIES[self.name]

    def read(self, config: str = "") -> S:
        """Read the study's scenario from its own file, or from `config`, a name or a path.

        Raises ConfigError if the file is missing or invalid.
        """
        return load(file_of(config or self.name, "study", FOLDERS), self.scenario)


def generator(seed: int, *words: str | float) -> np.random.Generator:
    """Create the random number generator of one job, from the seed and words that identify the job.

    Jobs with other words get independent numbers.
    """
    numbers = [int.from_bytes(repr(word).encode(), "little") for word in words]
    return np.random.default_rng([seed, *numbers])
