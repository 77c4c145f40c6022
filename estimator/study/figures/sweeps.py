"""Figure of study `analysis`: rms error of the scale factor over the value of each cause."""

from typing import Literal

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimator.figures.style import COLOURS
from estimator.study.analysis import Analysis
from estimator.study.simulation import METHODS, WORDS

_DASHES: dict[str, Literal["-", "--"]] = {"mean": "-", "point": "--"}
_MARKS = {"mean": "o", "point": "^"}


def analysis(found: Analysis) -> Figure:
    """Draw the rms error of the scale factors k (no unit) over the values of each cause, one panel per cause."""
    columns = -(-len(found.factors) // 2)
    figure = Figure(figsize=(3.7 * columns, 7.6))
    base = found.base
    figure.suptitle(
        f"Rms error of the scale factor, {found.runs} simulated sessions a point. Where not varied: noise "
        f"{base.noise_dps:g} °/s at {base.rate_hz:g} Hz,\nrests of {base.rest_s:g} s, turns of {base.turn_s:g} s about a "
        "fixed axis, device put back exactly",
        fontsize=12,
    )
    panels = figure.subplots(2, columns, sharey=True, squeeze=False)
    for factor, axes in zip(found.factors, panels.ravel(), strict=False):
        for how in factor.sampling:
            for method, colour in zip(METHODS, COLOURS, strict=False):
                rows = found.of(factor.name, method, how)
                axes.plot(
                    [r.value for r in rows], [r.k_rms for r in rows], _DASHES[how], marker=_MARKS[how], color=colour
                )
        rows = found.of(factor.name, METHODS[0])
        axes.plot([r.value for r in rows], [r.k_bound for r in rows], color="black", linestyle=":", linewidth=2)
        axes.set(title=factor.name, xlabel=factor.label, yscale="log")
        if factor.log:
            axes.set_xscale("log")
            shown = factor.values[:: 2 if len(factor.values) > 6 else 1]
            axes.set_xticks(shown, [f"{value:g}" for value in shown])
            axes.minorticks_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("rms error of $k$ (no unit)")
    for axes in panels.ravel()[len(found.factors) :]:
        axes.set_visible(False)
    how_words = {"mean": "averages over a sample", "point": "samples a point"}
    handles = [
        Line2D(
            [], [], color=colour, linestyle=_DASHES[how], marker=_MARKS[how], label=f"{WORDS[m]}, sensor that {words}"
        )
        for m, colour in zip(METHODS, COLOURS, strict=False)
        for how, words in how_words.items()
    ]
    handles.append(Line2D([], [], color="black", linestyle=":", linewidth=2, label="Cramér–Rao bound"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure
