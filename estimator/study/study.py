"""What a study is: a scenario from a TOML file, jobs whose parts become results, tables, figures and findings."""

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
In = TypeVar("In", bound=Struct)
R = TypeVar("R", bound=Struct)
#: one piece of work, the same for everybody who is given it: numbers and words
Job = tuple[str | int | float, ...]
#: what a job leaves, by name
Arrays = dict[str, NDArray[Any]]
Parts = Mapping[Job, Arrays]
Verdict = Literal["agrees", "agrees in part", "differs"]

_HERE = Path(__file__).parent
FOLDERS = (_HERE / "scenarios", _HERE.parents[1] / "configs" / "study")  # of an installed package; of a checkout


class Scenario(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What every study's file says. runs: how often; quick_runs: the same of a first look; seed: of all that is random."""

    runs: int
    quick_runs: int
    seed: int = 1

    def __post_init__(self) -> None:
        for key in ("runs", "quick_runs"):
            if (value := getattr(self, key)) < 1:
                raise ValueError(f"{key} is {value}; 1 or more is taken")


@dataclass(frozen=True, slots=True)
class Finding:
    """What a study says of one item of the paper: ours in words, and whether it agrees.

    item: its key in paper.ITEMS. why: in which part it does not agree, or what limits the comparison.
    """

    item: str
    ours: str
    verdict: Verdict
    why: str = ""


@dataclass(frozen=True, slots=True)
class Study(Generic[S, In, R]):
    """Compute, then draw.

    name: of the verb and of configs/study/NAME.toml, which is read as `scenario`. inputs: all that a job depends on; parts of
    equal work and inputs are equal. work(inputs, job) runs in another process. results(scenario, parts) is what
    results.json holds and all that tables, figures and findings are made of. draw(results, folder) leaves the figures and
    returns their names without suffix. findings(results): of the scenario that comes with truerate, for the report.
    """

    name: str
    scenario: type[S]
    inputs: Callable[[S], In]
    jobs: Callable[[In], Sequence[Job]]
    work: Callable[[In, Job], Arrays]
    results: Callable[[S, Parts], R]
    tables: Callable[[R], Sequence[RenderableType]]
    draw: Callable[[R, Path], Sequence[str]]
    findings: Callable[[R], Sequence[Finding]]

    @property
    def does(self) -> str:
        """In words."""
        return STUDIES[self.name]

    def read(self, config: str = "") -> S:
        """The scenario of this study's own file, or of another one; raises ConfigError."""
        return load(file_of(config or self.name, "study", FOLDERS), self.scenario)


def generator(seed: int, *words: str | float) -> np.random.Generator:
    """A stream of random numbers of its own for each job."""
    numbers = [int.from_bytes(repr(word).encode(), "little") for word in words]
    return np.random.default_rng([seed, *numbers])
