"""Loads and waits of many estimators; curves of benchmarks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from estimator.figures.style import COLOURS

Floats = NDArray[np.float64]


def scaling(found: dict[int, tuple[float, float, float, float]], devices: int, path: Path) -> None:
    """Of so many estimators: load, load when one has died, p99 and worst wait in s; side by side."""
    figure = Figure(figsize=(9, 3.6), dpi=130, layout="constrained")
    figure.suptitle(f"{devices} devices at 104 Hz, shared by several estimators, of which one dies")
    load, wait = figure.subplots(1, 2)
    numbers, columns = list(found), list(zip(*found.values(), strict=True))
    for axes, labels, parts in (
        (load, ("all alive", "one dead"), columns[:2]),
        (wait, ("p99 while all live", "worst"), columns[2:]),
    ):
        for colour, label, part in zip(COLOURS, labels, parts, strict=False):
            axes.plot(numbers, part, "o-", color=colour, label=label)
        axes.set(xlabel="estimators", xticks=numbers)
        axes.legend()
    load.axhline(1.0, color="black", linewidth=1, linestyle="--")
    load.set(ylabel="share of a core, the busiest", ylim=(0, None))
    wait.set(ylabel="s from arrival to corrected", yscale="log")
    figure.savefig(path)


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """One panel: named curves over the same numbers (n,), both axes logarithmic; NaN where there is none."""

    title: str
    across: str
    numbers: Floats
    curves: dict[str, Floats]
    goal: float | None = None


def curves(panels: Sequence[Curves], title: str, path: Path) -> None:
    """Panels side by side, what is to be reached dashed."""
    figure = Figure(figsize=(4.2 * len(panels), 3.8), dpi=130, layout="constrained")
    figure.suptitle(title)
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for colour, (label, values) in zip(COLOURS, panel.curves.items(), strict=False):
            axes.plot(panel.numbers, values, "o-", color=colour, label=label)
        if panel.goal is not None:
            axes.axhline(panel.goal, color="black", linewidth=1, linestyle="--", label="goal")
        axes.set(title=panel.title, xlabel=panel.across, xscale="log", yscale="log")
        axes.legend()
    figure.savefig(path)
