"""Bias trackers side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from estimator.figures.style import COLOURS

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """One panel: a row a scenario, for each method the value in it (NaN for none), and the goal of each row."""

    title: str
    rows: Sequence[str]
    values: dict[str, list[float]]
    goals: Sequence[float]
    log: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BiasDay:
    """One axis of a bias over a day at hours (n,): truth and tracks (n,) °/s, and what was done, by number, with its names."""

    hours: Floats
    truth_dps: Floats
    tracks_dps: dict[str, Floats]
    activity: NDArray[np.int8]
    names: Sequence[str]


def tracking(panels: Sequence[Dots], day: BiasDay, methods: Sequence[str], path: Path) -> None:
    """Trackers side by side in four panels, the first the tallest; below, a day with its activities."""
    figure = Figure(figsize=(13, 12), dpi=130)
    rooms = figure.subplot_mosaic(
        [["0", "1"], ["0", "2"], ["0", "3"], ["day", "day"], ["strip", "strip"]], height_ratios=[2, 7, 2, 9, 0.6]
    )
    colours = dict(zip(methods, COLOURS, strict=False))
    for name, panel in zip("0123", panels, strict=True):
        _dots(rooms[name], panel, colours)
    _tracks(rooms["day"], day, colours)
    _strip(rooms["strip"], rooms["day"], day)
    named = {
        label: handle for name in "0123" for handle, label in zip(*rooms[name].get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside upper center", ncols=len(named))
    figure.savefig(path)


def _dots(axes: Any, panel: Dots, colours: dict[str, str]) -> None:
    if not panel.rows:
        axes.set_axis_off()
        return
    height = -np.arange(len(panel.rows))
    for number, (method, values) in enumerate(panel.values.items()):
        apart = 0.5 * (0.5 - number / max(1, len(panel.values) - 1))
        if not np.all(np.isnan(values)):
            axes.plot(values, height + apart, "o", color=colours[method], markersize=7, label=method)
    axes.plot(panel.goals, height, "|", color="black", markersize=22, markeredgewidth=2, label="goal")
    for edge in height[:-1] - 0.5:
        axes.axhline(edge, color="black", alpha=0.12, linewidth=0.8)
    axes.set(title=panel.title, xscale="log" if panel.log else "linear", ylim=(height[-1] - 0.5, 0.5))
    axes.set_yticks(height, panel.rows)
    axes.grid(visible=False, axis="y")


def _tracks(axes: Any, day: BiasDay, colours: dict[str, str]) -> None:
    axes.plot(day.hours, day.truth_dps, color="black", linewidth=5, alpha=0.4, zorder=2.5)
    for method, track in day.tracks_dps.items():
        ours = method.startswith("truerate")
        axes.plot(day.hours, track, color=colours[method], linewidth=1.3 if ours else 0.8, zorder=3 if ours else 2)
    low, high = day.truth_dps.min(), day.truth_dps.max()
    around = 0.6 * (high - low)
    axes.set(
        title="One axis of a gyro over a simulated day on a ward; broad and grey: the truth",
        ylabel="bias, °/s",
    )
    axes.set(xlim=(0, day.hours[-1]), ylim=(low - around, high + around))
    axes.tick_params(labelbottom=False)


def _strip(axes: Any, above: Any, day: BiasDay) -> None:
    shades = [mpl.colormaps["Set3"](number) for number in range(len(day.names))]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(day.activity)) + 1, [len(day.activity) - 1]])
    for begin, end in pairwise(edges):
        axes.axvspan(day.hours[begin], day.hours[end], color=shades[day.activity[begin]], linewidth=0)
    done = sorted(set(day.activity.tolist()))
    handles = [Patch(color=shades[number], label=day.names[number]) for number in done]
    axes.sharex(above)
    axes.set(xlabel="hours", yticks=[])
    axes.legend(handles=handles, ncols=len(done), fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -1.8))
