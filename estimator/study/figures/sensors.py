"""Figure of tables 2 and 3 of Wang et al. 2024: errors of each method for a sensor, beside the paper's values."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimator.figures.style import AXES, COLOURS, PAPER
from estimator.study.sensors import Sensors
from estimator.study.trials import METHODS, WORDS


def sensor(found: Sensors, name: str) -> Figure:
    """Draw the errors of scale factors k (no unit) and b (°/s) by method, for one sensor; return the figure.

    One column per axis with k, k enlarged, and b. Each shows median and 95 % of each method's sessions, beside the
    paper's values. The paper's b is minus the bias.
    """
    figure = Figure(figsize=(11, 9.2))
    n = max(one.sessions for one in found.sessions)
    figure.suptitle(
        f"{found.labels[name]}: difference from the turntable column, {n} simulated sessions by each method",
        fontsize=13,
    )
    panels = figure.subplots(3, 3, sharex=True, sharey="row")
    for column, axis in enumerate(AXES):
        whole, enlarged, bias = panels[:, column]
        for axes, parameter, theirs in (
            (whole, f"k_{axis}", True),
            (enlarged, f"k_{axis}", False),
            (bias, f"b_{axis}", True),
        ):
            _differences(axes, found, name, parameter, theirs=theirs)
        whole.set_title(f"$k_{axis}$")
        enlarged.set_title(f"$k_{axis}$, enlarged")
        bias.set_title(f"$b_{axis}$")
        bias.set_xticks(range(len(METHODS)), [WORDS[m] for m in METHODS], rotation=45, ha="right")
    for axes, words in zip(panels[:, 0], ("k (no unit)", "k (no unit)", "b (°/s)"), strict=True):
        axes.set_ylabel(f"difference of {words}")
    handles = [
        Line2D([], [], marker="o", color="#555555", linestyle="none", label="median of the simulated sessions"),
        Line2D([], [], color="#555555", linewidth=7, alpha=0.35, label="95 % of the simulated sessions"),
        Line2D([], [], marker="D", color=PAPER, linestyle="none", label="the paper's value"),
        Line2D([], [], color="black", linewidth=1, label="the paper's turntable column: the truth of the simulation"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _differences(axes: Axes, found: Sensors, name: str, parameter: str, *, theirs: bool) -> None:
    axes.axhline(0.0, color="black", linewidth=1)
    axes.grid(visible=False, axis="x")
    for at, (method, colour) in enumerate(zip(METHODS, COLOURS, strict=False)):
        for row in (row for row in found.of(name, method) if row.parameter == parameter):
            axes.vlines(at, *row.error.band, color=colour, linewidth=7, alpha=0.35)
            axes.plot(at, row.error.median, "o", color=colour, markersize=6)
            if theirs and row.paper is not None and row.inside is not None:
                axes.plot(at, row.paper - row.truth, "D", color=PAPER, markersize=6)
