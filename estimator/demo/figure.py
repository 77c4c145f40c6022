"""Figure of the demonstration: heading, bias and scale factor errors of each device."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from estimator.demo.judge import Judgement
from estimator.figures.style import AXES, COLOURS

Floats = NDArray[np.float64]


def demo(boots: Sequence[Judgement], path: Path) -> None:
    """Draw heading errors of raw and corrected rates, the tracked bias and the scale factors against the truth.

    Headings are in degrees, biases in °/s. boots: one judgement per device. path: file to write.
    """
    figure = Figure(figsize=(11, 8.5), dpi=130)
    grid = figure.subplots(2, 2)
    raw, left = (
        max(float(np.abs(h).max()) for h in headings)
        for headings in ([boot.raw_heading_deg for boot in boots], [boot.corrected_heading_deg for boot in boots])
    )
    figure.suptitle(
        f"{len(boots)} wearables after three hand turns each: raw rates lose the heading by up to {raw:.0f}°, "
        f"corrected rates by {left:.1f}°",
        fontsize=12,
    )
    _heading(grid[0, 0], boots, "raw_heading_deg", "Raw rates: heading error")
    _heading(
        grid[0, 1],
        boots,
        "corrected_heading_deg",
        f"Corrected rates: heading error ({raw / left:.0f} times finer scale)",
    )
    _bias(grid[1, 0], boots[0])
    _scale(grid[1, 1], boots)
    figure.savefig(path)


def _heading(axes: Any, boots: Sequence[Judgement], what: str, title: str) -> None:
    for boot, colour in zip(boots, COLOURS * len(boots), strict=False):
        axes.plot(boot.time - boot.time[0], getattr(boot, what), color=colour, label=boot.device)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(title=title, xlabel="seconds since calibration", ylabel="heading error, degrees")
    axes.legend(fontsize=8, ncols=2)


def _bias(axes: Any, boot: Judgement) -> None:
    for axis, colour in zip(range(3), COLOURS, strict=False):
        error = boot.bias_dps[:, axis] - boot.bias_true_dps[:, axis]
        std = boot.bias_std_dps[:, axis]
        axes.plot(boot.time, error, color=colour, label=f"{AXES[axis]} estimate − truth")
        for side in (-2, 2):
            axes.plot(boot.time, side * std, color=colour, linewidth=0.8, linestyle=":")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(
        title=f"Bias error of {boot.device}; dotted: ±2 σ as published", xlabel="seconds since power-up", ylabel="°/s"
    )
    axes.legend(fontsize=8)


def _scale(axes: Any, boots: Sequence[Judgement]) -> None:
    for number, boot in enumerate(boots):
        for axis, colour in zip(range(3), COLOURS, strict=False):
            axes.errorbar(
                number + 0.2 * (axis - 1),
                100 * (boot.k[axis] / boot.k_true[axis] - 1),
                yerr=200 * boot.k_std[axis] / boot.k_true[axis],
                color=colour,
                fmt="o",
                markersize=4,
                capsize=2,
                label=AXES[axis] if number == 0 else None,
            )
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(title="Scale factor error after three hand turns, with ±2 σ", ylabel="scale factor error, %")
    axes.set_xticks(range(len(boots)), [boot.device for boot in boots], rotation=30, ha="right")
    axes.legend(fontsize=8, ncols=3)
