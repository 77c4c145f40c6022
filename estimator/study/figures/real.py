"""Figure of study `real`: scale factors and closure errors by each method in a real session, beside imucal's numbers."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from estimator.figures.style import AXES, COLOURS, PAPER
from estimator.study.real import WORDS, Real


def real(found: Real) -> Figure:
    """Draw scale factors (no unit) and closure errors (degrees) of a real session by every method."""
    rows = [row for row in found.rows if row.k is not None]
    figure = Figure(figsize=(12, 4.8))
    figure.suptitle(f"A real session ({found.recording}) through every method that applies", fontsize=13)
    *scales, closures = figure.subplots(1, 4, width_ratios=(1, 1, 1, 1.6))
    theirs = next(row for row in rows if row.method == "imucal")
    for i, axes in enumerate(scales):
        axes.axhline((theirs.k or [])[i], color=PAPER, linestyle="--", linewidth=1)
        for at, row in enumerate(row for row in rows if row.method != "imucal"):
            std = row.k_std or [0.0] * 3
            axes.errorbar(at, (row.k or [])[i], 1.96 * std[i], fmt="o", color=COLOURS[at], capsize=4)
        names = [WORDS[row.method] for row in rows if row.method != "imucal"]
        axes.set(
            title=f"$k_{AXES[i]}$", ylabel="scale factor (no unit)" if i == 0 else "", xlim=(-0.6, len(names) - 0.4)
        )
        axes.set_xticks(range(len(names)), names, rotation=35, ha="right")
        axes.ticklabel_format(axis="y", useOffset=False)
    closed = [row for row in rows if row.closure_deg is not None]
    for at, row in enumerate(closed):
        shift = 0.8 / len(closed) * (at - (len(closed) - 1) / 2)
        colour = (
            PAPER
            if row.method == "imucal"
            else COLOURS[[r.method for r in rows if r.method != "imucal"].index(row.method)]
        )
        closures.bar(np.arange(3) + shift, row.closure_deg or [], 0.75 / len(closed), color=colour, alpha=0.7)
    closures.set(title="closure error of the turns", ylabel="degrees")
    closures.set_xticks(range(3), [f"about {axis}" for axis in AXES])
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=PAPER, linestyle="--", label="imucal's scale factor"),
        Line2D([], [], color="#555555", marker="o", linestyle="-", label="ours, ±1.96 standard deviations"),
        *(Patch(color=PAPER if row.method == "imucal"
                else COLOURS[[r.method for r in rows if r.method != "imucal"].index(row.method)],
                alpha=0.7, label=f"closure by {WORDS[row.method]}") for row in closed),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure
