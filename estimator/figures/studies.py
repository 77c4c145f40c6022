"""Errors of many runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from estimator.figures.style import AXES, COLOURS

Floats = NDArray[np.float64]


def histogram(panels: dict[str, tuple[Floats, str]], title: str, path: Path) -> None:
    """One histogram a panel: errors of a study and their unit, with their rms."""
    figure = Figure(figsize=(4 * len(panels), 3.6), dpi=130)
    figure.suptitle(title)
    rooms = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (name, (values, unit)) in zip(rooms, panels.items(), strict=True):
        axes.hist(values, bins=30, color=COLOURS[0])
        axes.ticklabel_format(axis="x", style="sci", scilimits=(-2, 2))
        axes.locator_params(axis="x", nbins=5)
        axes.set(title=f"{name}: rms {np.sqrt(np.mean(values**2)):.1e}", xlabel=unit, ylabel="errors")
    figure.savefig(path)


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """One panel: sizes of errors (n, 3) of each method for x, y, z, on a log axis, and named levels across it."""

    title: str
    unit: str
    sizes: dict[str, Floats]
    lines: dict[str, float]


def boxes(panels: Sequence[Boxes], title: str, path: Path) -> None:
    """Two panels a row, a box for each method and axis: half of the errors in the box, 95 % below the upper whisker."""
    figure = Figure(figsize=(11, 0.6 + 3.6 * -(-len(panels) // 2)), dpi=130)
    figure.suptitle(title)
    rooms = figure.subplots(-(-len(panels) // 2), 2, squeeze=False).ravel()
    for axes, panel in zip(rooms, panels, strict=False):
        for number, (method, values) in enumerate(panel.sizes.items()):
            drawn = axes.boxplot(
                values,
                positions=np.arange(3) + 0.36 * (number - (len(panel.sizes) - 1) / 2),
                widths=0.3,
                whis=(2.5, 95),
                showfliers=False,
                patch_artist=True,
                medianprops={"color": "black"},
            )
            for box in drawn["boxes"]:
                box.set(facecolor=COLOURS[number], alpha=0.6, label=method if box is drawn["boxes"][0] else None)
        for number, (name, level) in enumerate(panel.lines.items()):
            axes.axhline(level, color="black", linewidth=1, linestyle=("--", ":")[number % 2], label=name)
        axes.set(title=panel.title, ylabel=panel.unit, yscale="log")
        axes.set_xticks(range(3), AXES)
    handles, labels = rooms[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.savefig(path)


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
